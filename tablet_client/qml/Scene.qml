import QtQuick
import QtQuick3D
import Handrail

// The 3-D view. Its own file: Quick 3D's names clash with those of some Controls styles. World: x forward, y left, z up, metres.
View3D {
    id: view

    property int smoothing: 0 // 0: none, 1: when nothing moves, 2: always, 3: for pictures
    property alias rig: rig

    // The camera, for models/view.py.
    function seen() {
        return { x: rig.focus.x, y: rig.focus.y, z: rig.focus.z, yaw: rig.yaw, pitch: rig.pitch, distance: rig.distance,
                 field: rig.camera.fieldOfView, width: view.width, height: view.height }
    }

    onSmoothingChanged: update() // a scene that stands still would keep its old edges
    objectName: "scene"
    camera: rig.camera
    // Straight into the window, where nothing is to be smoothed: a picture of its own costs a quarter of a frame in software.
    renderMode: smoothing === 0 ? View3D.Inline : View3D.Offscreen
    environment: SceneEnvironment {
        backgroundMode: SceneEnvironment.Transparent
        clearColor: "transparent"
        antialiasingMode: [SceneEnvironment.NoAA, SceneEnvironment.ProgressiveAA, SceneEnvironment.MSAA,
                           SceneEnvironment.SSAA][view.smoothing]
        antialiasingQuality: SceneEnvironment.High
    }

    CameraRig { id: rig }

    Node {
        id: world
        eulerRotation.x: -90 // robots' z up to Quick 3D's y up

        Model {
            geometry: stage.grid
            position: Qt.vector3d(0, 0, stage.floor)
            materials: SeeThrough { lit: 0 }
        }
        Repeater3D {
            model: stage.bodies
            Model {
                required property string name
                required property vector3d place
                required property quaternion turn
                required geometry
                objectName: "link_" + name
                position: place
                rotation: turn
                materials: robotMaterial
            }
        }
        Repeater3D {
            model: stage.templates
            Model {
                required property string name
                required property vector3d place
                required property quaternion turn
                required geometry
                objectName: "template_" + name
                position: place
                rotation: turn
                materials: templateMaterial
            }
        }
        Repeater3D {
            model: stage.waypoints
            Model {
                required property string name
                required property vector3d place
                required property quaternion turn
                required geometry
                objectName: "waypoint_" + name
                position: place
                rotation: turn
                    materials: cloudMaterial
            }
        }
        Model {
            objectName: "way"
            geometry: stage.way
            materials: cloudMaterial
        }
        // The handle is as large on the screen wherever it stands: models/handle.py has the same share.
        Node {
            id: handle
            objectName: "handle"
            visible: stage.selected !== ""
            position: stage.handle
            rotation: stage.handleTurn
            readonly property real length: Math.max(0.02, 0.17 * rig.eye.minus(stage.handle).length())
            scale: Qt.vector3d(length, length, length)
            Repeater3D {
                model: stage.handles
                Model {
                    required property string name
                    required property bool shown
                    required geometry
                    objectName: "handle_" + name
                    visible: shown
                                depthBias: -1000
                    materials: desk.bench.hot === name ? hotMaterial : handleMaterial
                }
            }
        }
        Repeater3D {
            model: stage.ghost
            Model {
                required property string name
                required property vector3d place
                required property quaternion turn
                required property bool shown
                required geometry
                objectName: "ghost_" + name
                position: place
                rotation: turn
                visible: shown
                    materials: stage.ghostStale ? staleMaterial : freshMaterial
            }
        }
        Repeater3D {
            model: stage.clouds
            Model {
                required property string name
                required geometry
                objectName: "cloud_" + name
                visible: stage.cloudOn
                    materials: cloudMaterial
            }
        }
        Model {
            objectName: "trail"
            visible: stage.ghostShown
            geometry: stage.trail
            materials: cloudMaterial
        }
    }

    Paint { id: robotMaterial }
    Paint { id: templateMaterial }
    Paint { id: cloudMaterial; lit: 0; cullMode: Material.NoCulling
            point: 0.005 * view.height / (2 * Math.tan(rig.camera.fieldOfView * Math.PI / 360)) } // 5 mm
    component SeeThrough: Paint {
        sourceBlend: CustomMaterial.SrcAlpha
        destinationBlend: CustomMaterial.OneMinusSrcAlpha
    }
    SeeThrough { id: handleMaterial; lit: 0; depthDrawMode: Material.NeverDepthDraw } // so it is drawn after everything else
    Paint { id: hotMaterial; lit: 0; glow: 1 }
    component Ghostly: SeeThrough {
        property color shade
        tint: Qt.rgba(shade.r, shade.g, shade.b, 0.42)
        glow: 0.12
    }
    Ghostly { id: freshMaterial; shade: Theme.accent }
    Ghostly { id: staleMaterial; shade: Theme.danger }
}
