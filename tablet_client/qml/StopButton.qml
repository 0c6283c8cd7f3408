import QtQuick
import QtQuick.Controls.Basic
import Handrail

// STOP: acts when it is touched, not when it is let go. Never disabled, always in the same corner.
AbstractButton {
    id: button

    property string progress: "" // "", sending, answered, failed
    property bool latched: false
    // also what the guard's STOP over this one says (tablet_client/stop_guard.py)
    readonly property color behind: Theme.panel
    readonly property string said: progress === "sending" ? qsTr("sending …")
        : progress === "failed" ? qsTr("NOT CONFIRMED")
        : latched ? qsTr("is latched") : qsTr("Esc or Space")

    text: qsTr("STOP")
    objectName: "stop"
    implicitWidth: Math.round(168 * Theme.scale)
    implicitHeight: Math.round(56 * Theme.scale)
    focusPolicy: Qt.TabFocus

    Accessible.role: Accessible.Button
    Accessible.name: qsTr("Stop the robot")
    Accessible.description: qsTr("Every drive stops at once. Keys: Escape or Space.")
    Accessible.onPressAction: desk.stop()

    onPressed: desk.stop()
    Keys.onReturnPressed: desk.stop()
    Keys.onEnterPressed: desk.stop()

    background: Rectangle {
        radius: Theme.radius
        color: button.down ? "#a5140c" : Theme.stop
        border.width: button.visualFocus ? 3 : 0
        border.color: "white"
    }
    contentItem: Item {
        Column {
            anchors.centerIn: parent
            Text {
                anchors.horizontalCenter: parent.horizontalCenter
                text: button.text
                color: "white"
                font.pixelSize: Math.round(22 * Theme.scale)
                font.weight: Font.Bold
                font.letterSpacing: 2
            }
            Text {
                anchors.horizontalCenter: parent.horizontalCenter
                text: button.said
                color: "#ffd9d6"
                font.pixelSize: Math.round(11.5 * Theme.scale)
                font.weight: button.progress === "failed" ? Font.Bold : Font.Normal
            }
        }
    }
}
