import QtQuick
import Handrail

// What must not be overlooked, across the window: stopped, stop not confirmed, connection lost, drives in fault.
Rectangle {
    id: banner

    property bool shown: true // where it stands, if there is something to say

    readonly property var view: desk.header
    readonly property string message:
        view.stopState === "failed"
            ? qsTr("STOP was not confirmed (%1). Use the hardware's emergency stop, or run “handrail stop” on the robot's computer.").arg(view.stopWhy)
        : view.stopState === "sending" && view.drives !== "stopped"
            ? qsTr("STOP is being sent …")
        : view.link === "lost"
            ? qsTr("Connection lost: what is shown is old. The robot goes on as programmed; “handrail stop” on its computer still works.")
        : view.drives === "stopped"
            ? qsTr("Stopped%1. Nothing moves until the stop is cleared and the drives are enabled.").arg(view.stopReason ? " (" + view.stopReason + ")" : "")
        : view.drives === "fault"
            ? qsTr("Drive fault: %1. Enable resets it when its cause is gone.").arg(view.faulty.join(", "))
        : view.drives === "quick_stop"
            ? qsTr("The drives stopped by themselves: no commands reached them. Enable them to go on.")
        : desk.recordings.replay.active
            ? qsTr("REPLAY: what is shown was recorded. The robot may move meanwhile; STOP stops it, nothing else is commanded from here.")
        : ""

    objectName: "banner"
    visible: shown && message !== ""
    implicitHeight: Math.max(Math.round(44 * Theme.scale), text.implicitHeight + 2 * Theme.gap)
    radius: Theme.radius
    color: Theme.badGround
    border.color: Theme.badLine
    Accessible.role: Accessible.AlertMessage
    Accessible.name: message

    Rectangle {
        anchors { left: parent.left; top: parent.top; bottom: parent.bottom; margins: Theme.tight }
        width: Math.round(5 * Theme.scale); radius: width / 2
        color: Theme.danger
    }
    Text {
        id: text
        anchors { verticalCenter: parent.verticalCenter; left: parent.left; right: parent.right
                  leftMargin: Math.round(22 * Theme.scale); rightMargin: Theme.gap }
        text: banner.message
        color: Theme.badText
        font.pixelSize: Theme.body
        font.weight: Font.Medium
        wrapMode: Text.Wrap
    }
}
