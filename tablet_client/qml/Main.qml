import QtQuick
import QtQuick.Layouts
import QtQuick.Window
import Handrail

// The operator's window.
Window {
    id: window

    property int smoothing: 0
    property string look: "robot"
    property bool beside: false // the 3-D view, beside a wide page
    // A question is answered with the ghost in sight.
    readonly property bool sceneShown: !Pages.wide || beside || desk.prompt.open

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

    Shortcut { sequences: ["Ctrl+Tab", "Ctrl+PgDown"]; onActivated: Pages.turn(1) }
    Shortcut { sequences: ["Ctrl+Shift+Tab", "Ctrl+PgUp"]; onActivated: Pages.turn(-1) }

    // What is selected is what one wants to see more of.
    readonly property string selected: desk.bench.view.selected
    onSelectedChanged: if (selected && !desk.prompt.open && !Pages.wide) Pages.open("objects")
    // What has just been started is what one wants to watch.
    readonly property int started: desk.library.view.started
    onStartedChanged: if (started > 0) Pages.open("task")

    property bool mayClose: false
    onClosing: close => {
        closeQuestion.unsaved = desk.workshop.code.view.unsaved
        if (mayClose || closeQuestion.unsaved === 0) return
        close.accepted = false
        closeQuestion.visible = true
    }
    CloseQuestion {
        id: closeQuestion
        anchors.centerIn: parent
        onCloseAnyway: { window.mayClose = true; window.close() }
    }

    ColumnLayout {
        anchors.fill: parent
        spacing: 0

        Header { Layout.fillWidth: true; z: 1 }
        RowLayout {
            Layout.fillWidth: true
            Layout.fillHeight: true
            Layout.margins: Theme.gap
            spacing: Theme.gap

            Rail { Layout.fillHeight: true }
            SceneToggle { visible: Pages.wide && !desk.prompt.open; open: window.beside; Layout.fillHeight: true; onClicked: window.beside = !window.beside }
            // The banner comes and goes on this side only: nothing moves away from under a finger on the other one.
            ColumnLayout {
                visible: window.sceneShown
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
                Layout.preferredWidth: Math.round(Pages.wide && !desk.prompt.open ? window.width * 0.55 : 372 * Theme.scale)
                Layout.fillWidth: !window.sceneShown
                Layout.fillHeight: true
                spacing: Theme.gap

                PromptCard { Layout.fillWidth: true }
                TourCard { Layout.fillWidth: true }
                Banner { objectName: "pageBanner"; shown: !window.sceneShown; Layout.fillWidth: true }
                PageStack { Layout.fillWidth: true; Layout.fillHeight: true }
            }
        }
    }
}
