import QtQuick
import QtQuick3D
import Handrail

// A camera that orbits a point. Angles in degrees; yaw 0 looks from the robot's right (−y), 90 from its front (+x).
Node {
    id: rig

    property alias camera: camera
    property real yaw: 38
    property real pitch: -14
    property real distance: 2.25
    property vector3d focus: Qt.vector3d(0.24, -0.12, 0.1) // world: z up

    readonly property vector3d eye: { // world
        const y = yaw * Math.PI / 180, p = pitch * Math.PI / 180
        const back = Qt.vector3d(Math.cos(p) * Math.sin(y), -Math.cos(p) * Math.cos(y), -Math.sin(p))
        return focus.plus(back.times(distance))
    }

    readonly property int _glide: 260

    function orbit(dx, dy) {
        yaw = (yaw - dx * 0.3) % 360
        pitch = Math.max(-89, Math.min(35, pitch - dy * 0.3))
    }
    function zoom(factor) {
        distance = Math.max(0.25, Math.min(8, distance / factor))
    }
    // A shift in pixels of a view `height` pixels high moves what is at the focus along with the finger.
    function pan(dx, dy, height) {
        const metres = 2 * distance * Math.tan(camera.fieldOfView * Math.PI / 360) / height
        const r = camera.right, u = camera.up
        const moved = r.times(-dx * metres).plus(u.times(dy * metres)) // Quick 3D's axes: y up
        focus = Qt.vector3d(focus.x + moved.x, focus.y - moved.z, focus.z + moved.y)
    }
    function look(toYaw, toPitch, toDistance, toFocus) {
        glide.stop()
        if (yaw === toYaw && pitch === toPitch && distance === toDistance && focus === toFocus) return
        const turn = ((toYaw - yaw + 540) % 360) - 180 // the short way round
        yawGlide.to = yaw + turn
        pitchGlide.to = toPitch
        distanceGlide.to = toDistance
        focusGlide.to = toFocus
        glide.start()
    }
    function preset(name) {
        const body = Qt.vector3d(0.24, -0.12, 0.1)
        if (name === "front") look(90, -8, 2.5, body)
        else if (name === "side") look(0, -6, 2.4, body)
        else if (name === "top") look(0, -89, 2.4, body)
        else if (name === "work") look(32, -14, 1.3, Qt.vector3d(stage.focus.x - 0.2, stage.focus.y + 0.05, stage.focus.z - 0.02))
        else look(38, -14, 2.25, body)
    }

    position: Qt.vector3d(focus.x, focus.z, -focus.y)
    eulerRotation: Qt.vector3d(pitch, yaw, 0)
    objectName: "rig"

    PerspectiveCamera {
        id: camera
        objectName: "camera"
        position: Qt.vector3d(0, 0, rig.distance)
        clipNear: 0.05
        clipFar: 40
        fieldOfView: 42
    }
    ParallelAnimation {
        id: glide
        NumberAnimation { id: yawGlide; target: rig; property: "yaw"; duration: rig._glide; easing.type: Easing.InOutQuad }
        NumberAnimation { id: pitchGlide; target: rig; property: "pitch"; duration: rig._glide; easing.type: Easing.InOutQuad }
        NumberAnimation { id: distanceGlide; target: rig; property: "distance"; duration: rig._glide; easing.type: Easing.InOutQuad }
        Vector3dAnimation { id: focusGlide; target: rig; property: "focus"; duration: rig._glide; easing.type: Easing.InOutQuad }
    }
}
