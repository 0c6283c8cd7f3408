import QtQuick
import QtQuick.Layouts
import Handrail

// The run in short: which program, how it stands, how far it got; why it does not go on, and what to do.
ColumnLayout {
    id: summary

    readonly property var view: desk.run.view
    readonly property bool any: view.status !== "none"
    readonly property bool bad: view.status === "failed" || view.failing

    spacing: Theme.tight

    RowLayout {
        Layout.fillWidth: true
        Caption { text: qsTr("Program"); Layout.fillWidth: true }
        Rectangle {
            visible: summary.any
            implicitWidth: statusText.implicitWidth + 2 * Theme.gap
            implicitHeight: statusText.implicitHeight + Theme.tight
            radius: height / 2
            color: "transparent"
            border.color: Words.runColor(summary.view.status)
            Text {
                id: statusText
                objectName: "runStatus"
                anchors.centerIn: parent
                text: Words.run(summary.view.status)
                color: Words.runColor(summary.view.status)
                font.pixelSize: Theme.small
                font.weight: Font.DemiBold
                Accessible.role: Accessible.StaticText
                Accessible.name: text
            }
        }
    }
    Column {
        visible: !summary.any
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
        visible: summary.any
        Layout.fillWidth: true
        spacing: Theme.gap
        Dial {
            visible: summary.view.turned >= 0 || summary.view.goal > 0
            turned: Math.max(summary.view.turned, 0)
            goal: summary.view.goal
            color: summary.view.status === "running" ? Theme.accent : Words.runColor(summary.view.status)
        }
        ColumnLayout {
            Layout.fillWidth: true
            spacing: Math.round(3 * Theme.scale)
            Text {
                objectName: "programName"
                Layout.fillWidth: true
                text: Words.name(summary.view.program)
                color: Theme.text
                font.pixelSize: Theme.large
                font.weight: Font.DemiBold
                elide: Text.ElideRight
            }
            Flow {
                Layout.fillWidth: true
                Layout.topMargin: Math.round(2 * Theme.scale)
                spacing: Math.round(10 * Theme.scale)
                Repeater {
                    model: summary.view.facts
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
                visible: summary.view.hash !== ""
                text: qsTr("content %1").arg(summary.view.hash.slice(0, 10))
                color: Theme.faint
                font.pixelSize: Math.round(12 * Theme.scale)
                font.family: "DejaVu Sans Mono, Consolas, Menlo, monospace"
            }
        }
    }
    // What went wrong, and what to do next.
    Rectangle {
        objectName: "failure"
        visible: why.text !== "" || next.text !== ""
        Layout.fillWidth: true
        implicitHeight: words.implicitHeight + 2 * Theme.tight
        radius: Theme.tight
        color: summary.bad ? Theme.badGround : "transparent"
        border.color: summary.bad ? Theme.badLine : "transparent"
        Accessible.role: summary.bad ? Accessible.AlertMessage : Accessible.StaticText
        Accessible.name: why.text + " " + next.text
        Column {
            id: words
            anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; margins: summary.bad ? Theme.gap : 0 }
            spacing: Math.round(3 * Theme.scale)
            Text {
                id: why
                objectName: "runDetail"
                width: parent.width
                visible: text !== ""
                text: summary.view.detail
                color: summary.bad ? Theme.badText : Theme.muted
                font.pixelSize: Theme.small
                wrapMode: Text.Wrap
            }
            Text {
                id: next
                objectName: "runAdvice"
                width: parent.width
                visible: text !== ""
                text: Words.advice(summary.view.advice)
                color: Theme.text
                font.pixelSize: Theme.small
                font.weight: Font.Medium
                wrapMode: Text.Wrap
            }
        }
    }
    Repeater {
        model: summary.view.warnings
        Text {
            required property string modelData
            Layout.fillWidth: true
            text: modelData
            color: Theme.warning
            font.pixelSize: Theme.small
            wrapMode: Text.Wrap
        }
    }
}
