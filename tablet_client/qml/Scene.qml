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
    environment: SceneEnvironment {
        backgroundMode: SceneEnvironment.Transparent
        clearColor: "transparent"
        antialiasingMode: [SceneEnvironment.NoAA, SceneEnvironment.ProgressiveAA, SceneEnvironment.MSAA,
                           SceneEnvironment.SSAA][view.smoothing]
        antialiasingQuality: SceneEnvironment.High
    }

    CameraRig { id: rig }
    DirectionalLight { eulerRotation: Qt.vector3d(-46, 20, 0); brightness: 0.72; ambientColor: Qt.rgba(0.13, 0.14, 0.16, 1) }
    DirectionalLight { eulerRotation: Qt.vector3d(-14, -105, 0); brightness: 0.32; color: "#c9deff" }

    Node {
        id: world
        eulerRotation.x: -90 // robots' z up to Quick 3D's y up

        Model {
            geometry: stage.grid
            position: Qt.vector3d(0, 0, stage.floor)
            materials: PrincipledMaterial {
                lighting: PrincipledMaterial.NoLighting
                vertexColorsEnabled: true
                alphaMode: PrincipledMaterial.Blend
            }
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
                castsShadows: false
                materials: cloudMaterial
            }
        }
        Model {
            objectName: "way"
            geometry: stage.way
            castsShadows: false
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
                    required geometry
                    objectName: "handle_" + name
                    castsShadows: false
                    receivesShadows: false
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
                castsShadows: false
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
                castsShadows: false
                receivesShadows: false
                materials: cloudMaterial
            }
        }
        Model {
            objectName: "trail"
            visible: stage.ghostShown
            geometry: stage.trail
            castsShadows: false
            materials: PrincipledMaterial { lighting: PrincipledMaterial.NoLighting; vertexColorsEnabled: true }
        }
    }

    PrincipledMaterial { id: robotMaterial; vertexColorsEnabled: true; roughness: 0.55; metalness: 0.0; specularAmount: 0.35 }
    PrincipledMaterial { id: templateMaterial; vertexColorsEnabled: true; roughness: 0.5; metalness: 0.0; specularAmount: 0.4 }
    PrincipledMaterial {
        id: cloudMaterial
        lighting: PrincipledMaterial.NoLighting
        vertexColorsEnabled: true
        cullMode: PrincipledMaterial.NoCulling
    }
    PrincipledMaterial { // transparent in name only: so it is drawn after everything else
        id: handleMaterial
        lighting: PrincipledMaterial.NoLighting
        vertexColorsEnabled: true
        alphaMode: PrincipledMaterial.Blend
        depthDrawMode: Material.NeverDepthDraw
    }
    PrincipledMaterial { id: hotMaterial; lighting: PrincipledMaterial.NoLighting; baseColor: "white" }
    component Ghostly: PrincipledMaterial {
        property color tint
        baseColor: Qt.rgba(tint.r, tint.g, tint.b, 0.42)
        emissiveFactor: Qt.vector3d(tint.r * 0.12, tint.g * 0.12, tint.b * 0.12)
        alphaMode: PrincipledMaterial.Blend
        roughness: 0.8
        specularAmount: 0.2
    }
    Ghostly { id: freshMaterial; tint: Theme.accent }
    Ghostly { id: staleMaterial; tint: Theme.danger }
}
