import QtQuick
import Handrail

// No robot to show: what is the matter, and what to do about it.
Item {
    id: empty

    readonly property var view: desk.header
    readonly property string mode: view.link === "waiting" ? "waiting" : stage.state === "loading" ? "loading"
        : stage.state === "failed" ? "failed" : ""

    objectName: "emptyScene"
    visible: mode !== ""
    Rectangle { anchors.fill: parent; color: Theme.ground; opacity: empty.mode === "waiting" ? 0.55 : 0.35; radius: Theme.radius }

    Panel {
        anchors.centerIn: parent
        width: Math.min(parent.width - 4 * Theme.gap, Math.round(560 * Theme.scale))
        height: column.implicitHeight + 4 * Theme.gap
        color: Qt.alpha(Theme.panel, 0.94)

        Column {
            id: column
            anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; margins: 2 * Theme.gap }
            spacing: Theme.gap

            Text {
                objectName: "emptyTitle"
                width: parent.width
                text: empty.mode === "waiting" ? qsTr("Waiting for a robot")
                    : empty.mode === "loading" ? qsTr("Preparing the model of %1").arg(empty.view.robot)
                    : qsTr("%1 can't be drawn").arg(empty.view.robot)
                color: Theme.text
                font.pixelSize: Math.round(24 * Theme.scale)
                font.weight: Font.DemiBold
                wrapMode: Text.Wrap
            }
            Rectangle {
                visible: empty.mode === "loading"
                width: parent.width; height: Math.round(6 * Theme.scale); radius: height / 2
                color: Theme.raised
                Rectangle { width: parent.width * stage.progress; height: parent.height; radius: height / 2; color: Theme.accent }
            }
            Text {
                width: parent.width
                text: empty.mode === "waiting"
                        ? (empty.view.tries > 0 ? qsTr("Nobody answers at %1 (%2 tries). This window goes on trying.").arg(empty.view.address).arg(empty.view.tries)
                                                : qsTr("Connecting to %1.").arg(empty.view.address))
                    : empty.mode === "loading" ? qsTr("Once for each robot; the result is kept.")
                    : stage.problem + "\n" + qsTr("Everything else works: state, program, questions and STOP.")
                color: Theme.muted
                font.pixelSize: Theme.body
                wrapMode: Text.Wrap
            }
            Text {
                visible: empty.mode === "waiting" && empty.view.linkWhy !== ""
                width: parent.width
                text: empty.view.linkWhy
                color: Theme.faint
                font.pixelSize: Theme.small
                wrapMode: Text.Wrap
                maximumLineCount: 3
                elide: Text.ElideRight
            }
            Text {
                visible: empty.mode === "waiting"
                topPadding: Theme.tight
                text: qsTr("Start one on the robot's computer")
                color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium
            }
            Command { visible: empty.mode === "waiting"; width: parent.width; text: "handrail up talos_upper --scene valve" }
            Text {
                visible: empty.mode === "waiting"
                width: parent.width
                text: qsTr("or, at the first contact with one elsewhere, type the code that “handrail pair” shows there")
                color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium
                wrapMode: Text.Wrap
            }
            FirstContact { visible: empty.mode === "waiting"; width: parent.width }
        }
    }
}
