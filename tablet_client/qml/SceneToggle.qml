import QtQuick
import QtQuick.Controls.Basic
import Handrail

// Beside a wide page: brings the 3-D view back, and takes it away again.
AbstractButton {
    id: toggle

    property bool open: false

    objectName: "sceneToggle"
    implicitWidth: Math.max(44, Math.round(44 * Theme.scale))
    focusPolicy: Qt.StrongFocus
    text: open ? qsTr("Hide the 3-D view") : qsTr("Show the 3-D view")
    Accessible.role: Accessible.Button
    Accessible.name: text
    Keys.onReturnPressed: click()
    Keys.onEnterPressed: click()
    background: Rectangle {
        radius: Theme.radius
        color: toggle.down ? Theme.pressed : Theme.panel
        border { width: toggle.visualFocus ? 2 : 1; color: toggle.visualFocus ? Theme.accent : Theme.line }
    }
    contentItem: Item {
        Text {
            anchors.centerIn: parent
            rotation: -90
            text: toggle.text
            color: Theme.muted
            font.pixelSize: Theme.body
            font.weight: Font.Medium
        }
    }
}
