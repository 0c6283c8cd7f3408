import QtQuick
import QtQuick.Controls.Basic
import Handrail

// What a camera sees, from where it stands.
Rectangle {
    id: inset

    readonly property var view: desk.camera.view

    objectName: "cameraInset"
    visible: view.open
    width: Math.round(288 * Theme.scale)
    height: Math.round(216 * Theme.scale)
    radius: Theme.tight
    color: Theme.ground
    border.color: Theme.line
    Accessible.role: Accessible.Graphic
    Accessible.name: qsTr("What the camera %1 sees").arg(Words.name(view.camera))

    CameraPicture { anchors { fill: parent; margins: 1 } desk: inset.shown }
    readonly property var shown: desk.camera
    Row {
        visible: inset.view.cameras.length > 1
        anchors { left: parent.left; bottom: parent.bottom; margins: Theme.tight }
        spacing: Theme.tight
        Repeater {
            model: inset.view.cameras
            ActionButton {
                required property string modelData
                objectName: "camera_" + modelData
                text: Words.name(modelData)
                checked: inset.view.camera === modelData
                opacity: 0.9
                Accessible.name: qsTr("Camera: %1").arg(text)
                Accessible.checkable: true
                Accessible.checked: checked
                onClicked: desk.camera.choose(modelData)
            }
        }
    }
}
