import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The program that runs: its tree of states, how far it got, and the operator's hand on it.
Panel {
    id: panel

    readonly property var view: desk.run.view
    readonly property bool any: view.status !== "none"
    readonly property bool under: view.status === "running" || view.status === "paused"
    readonly property int _edge: Math.round(14 * Theme.scale)

    ColumnLayout {
        anchors { fill: parent; margins: panel._edge }
        spacing: Theme.tight

        ListView {
            id: tree
            objectName: "programTree"
            Layout.fillWidth: true
            Layout.fillHeight: true
            clip: true
            model: desk.run.tree
            boundsBehavior: Flickable.StopAtBounds
            activeFocusOnTab: false
            Accessible.role: Accessible.Tree
            Accessible.name: qsTr("The program's states")
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
            header: TaskSummary { width: tree.width }
            delegate: StateRow { width: tree.width - Theme.tight }

            // What runs stays in sight, unless someone is looking at something else.
            readonly property string lit: panel.under ? panel.view.innermost : ""
            onLitChanged: if (!panel.view.chosen && !moving) Qt.callLater(follow)
            onCountChanged: Qt.callLater(follow)
            // What stands above the states grows a line or two after they are there, as words wrap.
            readonly property real head: headerItem ? headerItem.height : 0
            onHeadChanged: if (!moving) Qt.callLater(follow)
            readonly property bool under: panel.under
            onUnderChanged: Qt.callLater(follow)
            function follow() {
                positionViewAtBeginning() // how it ended stands above; and where the state is in sight from there, so does it
                if (!panel.under) return
                for (let i = 0; i < count; ++i)
                    if (model.data(model.index(i, 0), 256) === lit) { positionViewAtIndex(i, ListView.Contain); return }
            }
        }

        RowLayout {
            visible: panel.any && !desk.prompt.open
            Layout.fillWidth: true
            spacing: Theme.tight
            Text { text: qsTr("Asks"); color: Theme.muted; font.pixelSize: Theme.small }
            Repeater {
                model: [{ level: "off", title: qsTr("always") }, { level: "low", title: qsTr("often") },
                        { level: "high", title: qsTr("seldom") }, { level: "full", title: qsTr("never") }]
                ActionButton {
                    required property var modelData
                    objectName: "autonomy_" + modelData.level
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: modelData.title
                    checked: panel.view.autonomy === modelData.level
                    font.pixelSize: Theme.small
                    Accessible.name: qsTr("The program asks %1 (autonomy %2)").arg(text).arg(modelData.level)
                    Accessible.checkable: true
                    Accessible.checked: checked
                    enabled: panel.view.why.autonomy === ""
                    onClicked: desk.run.setAutonomy(modelData.level)
                }
            }
        }
        GridLayout {
            visible: panel.any
            Layout.fillWidth: true
            columns: 6
            columnSpacing: Theme.tight
            rowSpacing: Theme.tight

            component Do: ActionButton {
                required property string command
                objectName: command
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                Layout.columnSpan: panel.under ? 2 : 3
                why: Words.why(panel.view.why[command])
                onClicked: desk.run.command(command)
            }
            Do { command: "pause"; visible: panel.under && panel.view.status !== "paused"; text: qsTr("Pause") }
            Do { command: "resume"; visible: panel.view.status === "paused"; tone: "primary"; text: panel.view.failing ? qsTr("Try again") : qsTr("Resume") }
            Do { command: "start"; visible: !panel.under; tone: "primary"; text: qsTr("Run again"); Accessible.description: why }
            Do { command: "step"; text: qsTr("Step"); visible: panel.under }
            Do { command: "repeat"; text: qsTr("Repeat"); visible: !panel.under; Accessible.name: qsTr("Run the last state again") }
            Do { objectName: "stopRun"; command: "stop_run"; tone: "danger"; text: qsTr("End"); Accessible.name: qsTr("End the program"); visible: panel.under }
            Do { command: "skip"; Layout.columnSpan: 3; text: qsTr("Skip state"); visible: panel.under && !desk.prompt.open }
            Do { command: "let_fail"; Layout.columnSpan: 3; text: qsTr("Let it fail"); visible: panel.view.failing && !desk.prompt.open }
            Do { objectName: "repeatState"; Layout.columnSpan: 3; command: "repeat"; text: qsTr("Repeat state"); visible: panel.under && !panel.view.failing && !desk.prompt.open }
        }
    }
}
