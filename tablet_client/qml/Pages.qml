pragma Singleton
import QtQuick
import Handrail

// Every page of the window, in the rail's order; the one place where a page is registered. Its file is loaded when it is first shown.
// `name`: what tests, pictures and other pages know it by. `wide`: an editor, which takes the 3-D view's room.
QtObject {
    property var all: [
        { group: qsTr("Operate"), name: "task", title: qsTr("Run"), file: "TaskPanel.qml" },
        { group: qsTr("Operate"), name: "objects", title: qsTr("Objects"), file: "ObjectsPanel.qml" },
        { group: qsTr("Operate"), name: "robot", title: qsTr("Robot"), file: "RobotPanel.qml" },
        { group: qsTr("Program"), name: "library", title: qsTr("Library"), file: "LibraryPanel.qml" },
        { group: qsTr("Program"), name: "canvas", title: qsTr("Canvas"), file: "CanvasPanel.qml", wide: true },
        { group: qsTr("Program"), name: "code", title: qsTr("Code"), file: "CodePanel.qml", wide: true },
        { group: qsTr("Teleoperate"), name: "move", title: qsTr("Move"), file: "MovePanel.qml" },
        { group: qsTr("See"), name: "signals", title: qsTr("Signals"), file: "SignalsPanel.qml" },
        { group: qsTr("See"), name: "recordings", title: qsTr("Record"), file: "RecordingsPanel.qml" },
        { group: qsTr("See"), name: "health", title: qsTr("Health"), file: "HealthPanel.qml", wide: true },
        { group: qsTr("See"), name: "journal", title: qsTr("History"), file: "JournalPanel.qml" },
        { group: qsTr("See"), name: "output", title: qsTr("Output"), file: "OutputPanel.qml", wide: true },
    ]
    readonly property var marks: ({ task: desk.run.view.status === "failed" ? Theme.danger : "", health: desk.health.view.troubled ? Theme.danger : "", recordings: desk.recordings.view.running ? Theme.danger : "" }) // a page that should be looked at
    property string current: "task"
    readonly property bool wide: all.some(page => page.name === current && page.wide === true)

    property string section: "" // of the page, to be brought into sight

    function open(name, part) {
        section = part || ""
        if (all.some(page => page.name === name)) current = name
        else console.error("no page " + name)
    }

    // `by` pages on from the current one, around.
    function turn(by) {
        const at = all.findIndex(page => page.name === current)
        current = all[(at + by + all.length) % all.length].name
    }
}
