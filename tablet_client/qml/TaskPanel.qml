import QtQuick
import QtQuick.Layouts
import Handrail

// The program that runs: where it stands, how far it got, and the way to pause or end it.
Panel {
    id: panel

    readonly property var view: desk.task
    readonly property bool any: view.status !== "none"

    implicitHeight: column.implicitHeight + 2 * Math.round(16 * Theme.scale)

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; top: parent.top; margins: Math.round(16 * Theme.scale) }
        spacing: Theme.gap

        RowLayout {
            Layout.fillWidth: true
            Caption { text: qsTr("Program"); Layout.fillWidth: true }
            Rectangle {
                visible: panel.any
                implicitWidth: statusText.implicitWidth + 2 * Theme.gap
                implicitHeight: statusText.implicitHeight + Theme.tight
                radius: height / 2
                color: "transparent"
                border.color: Words.runColor(panel.view.status)
                Text {
                    id: statusText
                    objectName: "runStatus"
                    anchors.centerIn: parent
                    text: Words.run(panel.view.status)
                    color: Words.runColor(panel.view.status)
                    font.pixelSize: Theme.small
                    font.weight: Font.DemiBold
                    Accessible.role: Accessible.StaticText
                    Accessible.name: text
                }
            }
        }

        Column {
            visible: !panel.any
            Layout.fillWidth: true
            spacing: Theme.tight
            Text { text: qsTr("No program runs."); color: Theme.text; font.pixelSize: Theme.large }
            Text {
                width: parent.width
                visible: desk.header.link === "attached"
                text: qsTr("Start one on the robot's computer:")
                color: Theme.muted; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            }
            Command {
                width: parent.width
                visible: desk.header.link === "attached"
                text: "handrail program run turn_valve --bind arm=right --bind valve=" + (desk.header.places[0] || "INSTANCE")
            }
        }

        RowLayout {
            visible: panel.any
            Layout.fillWidth: true
            spacing: Theme.gap
            Dial {
                visible: panel.view.turned >= 0 || panel.view.goal > 0
                turned: Math.max(panel.view.turned, 0)
                goal: panel.view.goal
                color: panel.view.status === "running" ? Theme.accent : Words.runColor(panel.view.status)
            }
            ColumnLayout {
                Layout.fillWidth: true
                spacing: Math.round(3 * Theme.scale)
                Text {
                    objectName: "programName"
                    Layout.fillWidth: true
                    text: Words.name(panel.view.program)
                    color: Theme.text
                    font.pixelSize: Theme.large
                    font.weight: Font.DemiBold
                    elide: Text.ElideRight
                }
                Text {
                    objectName: "activeStates"
                    Layout.fillWidth: true
                    visible: panel.view.active.length > 0
                    text: panel.view.active.map(s => Words.name(s)).join(" › ")
                    color: Theme.accent
                    font.pixelSize: Theme.body
                    wrapMode: Text.Wrap
                    maximumLineCount: 2
                    elide: Text.ElideRight
                }
                Flow {
                    Layout.fillWidth: true
                    Layout.topMargin: Math.round(2 * Theme.scale)
                    spacing: Math.round(10 * Theme.scale)
                    Repeater {
                        model: panel.view.facts
                        Row {
                            required property var modelData
                            spacing: Math.round(5 * Theme.scale)
                            Text { text: modelData.label; color: Theme.muted; font.pixelSize: Theme.small }
                            Text { text: modelData.text; color: Theme.text; font.pixelSize: Theme.small; font.weight: Font.DemiBold }
                        }
                    }
                }
                Text {
                    objectName: "programHash"
                    visible: panel.view.hash !== ""
                    text: qsTr("content %1").arg(panel.view.hash.slice(0, 10))
                    color: Theme.faint
                    font.pixelSize: Math.round(12 * Theme.scale)
                    font.family: "DejaVu Sans Mono, Consolas, Menlo, monospace"
                }
            }
        }
        Text {
            visible: panel.view.detail !== ""
            Layout.fillWidth: true
            text: panel.view.detail
            color: panel.view.status === "failed" ? "#ffaaa4" : Theme.muted
            font.pixelSize: Theme.small
            wrapMode: Text.Wrap
            maximumLineCount: 4
            elide: Text.ElideRight
        }
        RowLayout {
            visible: panel.any
            Layout.fillWidth: true
            spacing: Theme.tight
            ActionButton {
                objectName: "pause"
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                visible: panel.view.status !== "paused"
                text: qsTr("Pause")
                why: Words.why(panel.view.pauseWhy)
                onClicked: desk.command("pause")
            }
            ActionButton {
                objectName: "resume"
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                visible: panel.view.status === "paused"
                tone: "primary"
                text: qsTr("Resume")
                why: Words.why(panel.view.resumeWhy)
                onClicked: desk.command("resume")
            }
            ActionButton {
                objectName: "stopRun"
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                tone: "danger"
                text: qsTr("End program")
                why: Words.why(panel.view.stopWhy)
                onClicked: desk.command("stop_run")
            }
        }
    }
}
