import QtQuick
import QtQuick.Layouts
import QtQuick.Window
import Handrail

// The operator's window.
Window {
    id: window

    property int smoothing: 0
    property string look: "robot"

    width: 1280
    height: 800
    minimumWidth: 1024
    minimumHeight: 640
    title: desk.header.robot ? qsTr("%1 – Handrail").arg(desk.header.robot) : qsTr("Handrail")
    color: Theme.ground

    Binding {
        target: Theme
        property: "scale"
        value: Math.max(0.9, Math.min(1.35, Math.min(window.width / 1280, window.height / 800)))
    }

    // STOP from anywhere in the window, whatever has the focus. Enter, not Space, presses buttons.
    Shortcut { sequences: ["Escape", "Space", "F12"]; context: Qt.ApplicationShortcut; autoRepeat: false; onActivated: desk.stop() }

    ColumnLayout {
        anchors.fill: parent
        spacing: 0

        Header { Layout.fillWidth: true; z: 1 }
        RowLayout {
            Layout.fillWidth: true
            Layout.fillHeight: true
            Layout.margins: Theme.gap
            spacing: Theme.gap

            // The banner comes and goes on this side only: nothing moves away from under a finger on the other one.
            ColumnLayout {
                spacing: Theme.gap
                Banner { Layout.fillWidth: true }
                ScenePanel {
                    objectName: "scenePanel"
                    Layout.fillWidth: true
                    Layout.fillHeight: true
                    smoothing: window.smoothing
                    look: window.look
                }
            }
            ColumnLayout {
                Layout.preferredWidth: Math.round(372 * Theme.scale)
                Layout.fillWidth: false
                Layout.fillHeight: true
                spacing: Theme.gap

                PromptCard { Layout.fillWidth: true }
                Tabs {
                    id: tabs
                    objectName: "tabs"
                    Layout.fillWidth: true
                    // What is selected is what one wants to see more of.
                    readonly property string selected: desk.bench.view.selected
                    onSelectedChanged: if (selected && !desk.prompt.open) page = "objects"
                    pages: [
                        { name: "task", title: qsTr("Program"), mark: desk.run.view.status === "failed" ? Theme.danger : "" },
                        { name: "library", title: qsTr("Library"), mark: "" },
                        { name: "objects", title: qsTr("Objects"), mark: "" },
                        { name: "move", title: qsTr("Move"), mark: "" },
                        { name: "signals", title: qsTr("Signals"), mark: "" },
                        { name: "robot", title: qsTr("Robot"), mark: "" },
                        { name: "journal", title: qsTr("History"), mark: "" },
                    ]
                }
                TaskPanel { visible: tabs.page === "task"; Layout.fillWidth: true; Layout.fillHeight: true }
                LibraryPanel { visible: tabs.page === "library"; Layout.fillWidth: true; Layout.fillHeight: true; onStarted: tabs.page = "task" }
                ObjectsPanel { visible: tabs.page === "objects"; Layout.fillWidth: true; Layout.fillHeight: true }
                MovePanel { visible: tabs.page === "move"; Layout.fillWidth: true; Layout.fillHeight: true }
                SignalsPanel { visible: tabs.page === "signals"; Layout.fillWidth: true; Layout.fillHeight: true }
                RobotPanel { visible: tabs.page === "robot"; Layout.fillWidth: true; Layout.fillHeight: true }
                JournalPanel { visible: tabs.page === "journal"; Layout.fillWidth: true; Layout.fillHeight: true; clip: true }
            }
        }
    }
}
