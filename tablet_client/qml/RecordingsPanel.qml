import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// Recordings on the robot's computer: begin, mark, end, and see one again in the same view.
Panel {
    id: panel

    readonly property var view: desk.recordings.view

    onVisibleChanged: desk.recordings.watch(visible)
    Component.onCompleted: desk.recordings.watch(visible)
    Component.onDestruction: desk.recordings.watch(false)

    component Line: Text {
        Layout.fillWidth: true
        color: Theme.text; font.pixelSize: Theme.small; wrapMode: Text.Wrap
        Accessible.role: Accessible.StaticText
        Accessible.name: text
    }
    component Field: TextField {
        id: input
        Layout.fillWidth: true
        Layout.preferredHeight: Theme.touch
        color: Theme.text
        placeholderTextColor: Theme.faint
        font.pixelSize: Theme.body
        selectByMouse: true
        maximumLength: 200
        Accessible.role: Accessible.EditableText
        Accessible.name: placeholderText
        Keys.onEscapePressed: desk.stop()
        background: Rectangle {
            radius: Theme.tight
            color: Theme.ground
            border { width: input.activeFocus ? 2 : 1; color: input.activeFocus ? Theme.accent : Theme.line }
        }
    }

    ColumnLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Theme.gap

        Caption { text: panel.view.running ? qsTr("Recording") : qsTr("New recording") }
        RowLayout {
            visible: panel.view.running !== ""
            Layout.fillWidth: true
            spacing: Theme.gap
            Chip { Layout.fillWidth: true; text: panel.view.running; detail: Words.minutes(panel.view.runningFor); color: Theme.danger }
            ActionButton { objectName: "stopRecording"; text: qsTr("End it"); why: Words.why(panel.view.why.stop); onClicked: desk.recordings.stop() }
        }
        RowLayout {
            visible: panel.view.running !== ""
            Layout.fillWidth: true
            spacing: Theme.gap
            Field { id: words; objectName: "markText"; placeholderText: qsTr("What happens now"); onAccepted: mark.click() }
            ActionButton {
                id: mark
                objectName: "mark"
                text: qsTr("Mark")
                why: words.text.trim() === "" ? qsTr("write what") : Words.why(panel.view.why.mark)
                onClicked: { desk.recordings.mark(words.text); words.clear() }
            }
        }
        RowLayout {
            visible: panel.view.running === ""
            Layout.fillWidth: true
            spacing: Theme.gap
            Field { id: name; objectName: "recordingName"; placeholderText: qsTr("Name, else the time"); maximumLength: 60; onAccepted: record.click() }
            ActionButton {
                id: record
                objectName: "startRecording"
                tone: "primary"
                text: qsTr("Record")
                why: Words.why(panel.view.why.start)
                onClicked: { desk.recordings.start(name.text); name.clear() }
            }
        }
        Line { objectName: "recordingsProblem"; visible: text !== ""; text: panel.view.problem; color: Theme.danger }

        RowLayout {
            Layout.fillWidth: true
            Caption { text: qsTr("On the robot"); Layout.fillWidth: true }
            Text { visible: panel.view.known; text: qsTr("%1 GB free").arg(panel.view.free); color: panel.view.free < 2 ? Theme.warning : Theme.muted; font.pixelSize: Math.round(12 * Theme.scale) }
        }
        Line {
            visible: list.count === 0
            color: Theme.muted
            text: desk.header.link !== "attached" ? qsTr("Nobody is connected.") : panel.view.known
                ? qsTr("None yet. Record what the robot does, to see it again here or in Foxglove.") : panel.view.problem ? "" : qsTr("Being asked …")
        }
        ListView {
            id: list
            objectName: "recordingsList"
            Layout.fillWidth: true
            Layout.fillHeight: true
            clip: true
            spacing: Theme.tight
            boundsBehavior: Flickable.StopAtBounds
            model: desk.recordings.found
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
            delegate: ColumnLayout {
                id: row
                required property string name
                required property string when
                required property real seconds
                required property real megabytes
                required property var marks
                required property string problem
                required property bool fits
                readonly property bool shown: desk.recordings.replay.name === name
                width: list.width - Theme.tight
                spacing: 2
                RowLayout {
                    Layout.fillWidth: true
                    spacing: Theme.gap
                    ColumnLayout {
                        Layout.fillWidth: true
                        spacing: 0
                        Text { Layout.fillWidth: true; text: row.name; color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium; elide: Text.ElideRight }
                        Line {
                            text: row.problem ? row.problem
                                : qsTr("%1 · %2 · %3 MB").arg(row.when).arg(Words.minutes(row.seconds)).arg(row.megabytes.toFixed(row.megabytes < 10 ? 1 : 0))
                            color: row.problem ? Theme.warning : Theme.muted
                        }
                    }
                    ActionButton {
                        objectName: "replay_" + row.name
                        text: row.shown ? qsTr("Live") : qsTr("Replay")
                        tone: row.shown ? "primary" : "plain"
                        why: row.problem ? qsTr("not complete") : row.fits ? "" : qsTr("another robot")
                        Accessible.name: row.shown ? qsTr("Back to live") : qsTr("Replay %1").arg(row.name)
                        onClicked: row.shown ? desk.recordings.back() : desk.recordings.show(row.name)
                    }
                }
                Repeater {
                    model: row.shown ? row.marks : []
                    ActionButton {
                        required property var modelData
                        required property int index
                        objectName: "goto_" + index
                        Layout.fillWidth: true
                        text: qsTr("%1  %2").arg(Words.minutes(modelData.at)).arg(modelData.text)
                        onClicked: desk.recordings.scrub(modelData.at)
                    }
                }
                Line { visible: !row.shown && row.marks.length > 0; color: Theme.muted; text: row.marks.length === 1 ? qsTr("1 mark") : qsTr("%1 marks").arg(row.marks.length) }
            }
        }
    }
}
