import QtQuick
import QtQuick.Layouts
import Handrail

// Which robot, is it there, may it move, and how to stop it.
Rectangle {
    id: header

    readonly property var view: desk.header

    implicitHeight: Math.round(76 * Theme.scale)
    color: Theme.panel

    Rectangle { anchors.bottom: parent.bottom; width: parent.width; height: 1; color: Theme.line }

    RowLayout {
        anchors { fill: parent; leftMargin: Math.round(20 * Theme.scale); rightMargin: Theme.gap }
        spacing: Math.round(28 * Theme.scale)

        Column {
            Text {
                objectName: "robotName"
                text: header.view.robot || qsTr("Handrail")
                color: Theme.text
                font.pixelSize: Theme.title
                font.weight: Font.DemiBold
                Accessible.role: Accessible.Heading
                Accessible.name: text
            }
            Text {
                text: header.view.clock ? Words.clock(header.view.clock, header.view.time)
                                          + (header.view.held ? qsTr(" · held") : "") : header.view.address
                color: Theme.muted
                font.pixelSize: Math.round(12 * Theme.scale)
            }
        }
        Chip {
            objectName: "linkChip"
            text: Words.link(header.view.link)
            detail: header.view.link === "attached"
                ? (!header.view.engine ? qsTr("engine does not answer")
                    : desk.health.link.quality === "unknown" ? header.view.address
                    : qsTr("%1 · %2").arg(Words.milliseconds(desk.health.link.latency)).arg(Words.rate(desk.health.link.rate)))
                : header.view.link === "lost" ? qsTr("for %1 s, trying again").arg(header.view.lostFor)
                : qsTr("%1 tries").arg(header.view.tries)
            color: header.view.link === "attached" ? (!header.view.engine ? Theme.warning : desk.health.link.quality === "unknown" ? Theme.good : Words.qualityColor(desk.health.link.quality))
                : header.view.link === "lost" ? Theme.danger : Theme.warning
        }
        Chip {
            objectName: "drivesChip"
            visible: header.view.drives !== "unknown"
            opacity: header.view.link === "attached" ? 1 : 0.45
            text: Words.drives(header.view.drives)
            detail: header.view.drives === "stopped" ? header.view.stopReason
                : header.view.drives === "fault" ? header.view.faulty.join(", ")
                : header.view.drives === "enabled" ? (header.view.moving ? qsTr("moving") : qsTr("holding"))
                    + (header.view.speed < 100 ? qsTr(" · %1 % speed").arg(header.view.speed) : "") : ""
            color: Words.drivesColor(header.view.drives)
        }
        Item { Layout.fillWidth: true }
        ActionButton {
            objectName: "clearStop"
            visible: header.view.drives === "stopped"
            text: qsTr("Clear stop")
            why: Words.why(header.view.clearWhy)
            implicitHeight: Math.round(56 * Theme.scale)
            onClicked: desk.command("clear_stop")
        }
        ActionButton {
            objectName: "enable"
            text: qsTr("Enable")
            why: Words.why(header.view.enableWhy)
            tone: "primary"
            implicitHeight: Math.round(56 * Theme.scale)
            implicitWidth: Math.round(132 * Theme.scale)
            onClicked: desk.command("enable")
        }
        StopButton {
            progress: header.view.stopState
            latched: header.view.drives === "stopped"
        }
    }
}
