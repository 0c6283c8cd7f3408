import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// A program as a picture of its states, or a node that is made of nodes as one of its parts: edited here, saved as the same YAML,
// comments and all.
Panel {
    id: panel

    readonly property var canvas: desk.workshop.canvas
    readonly property var graph: desk.workshop.graph
    readonly property var code: desk.workshop.code
    readonly property bool wired: code.view.kind === "node" && code.view.file.endsWith(".yaml")
    readonly property var drawing: wired ? graph : canvas // what is shown
    readonly property var view: drawing.view
    readonly property bool open: (code.view.kind === "program" || wired) && code.view.loaded
    readonly property bool can: open && view.whyEdit === ""
    readonly property bool some: wired ? graph.view.kind !== "" : canvas.view.state.name !== undefined
    readonly property real zoom: ground.item ? ground.item.zoom : 1
    property bool adding: false // a node is chosen, to be a part

    onVisibleChanged: watch()
    onWiredChanged: adding = false
    Component.onCompleted: watch()
    function watch() {
        canvas.watch(visible)
        graph.watch(visible)
    }

    component Tool: ActionButton { opacity: enabled ? 1 : 0.45 }
    component Entry: ActionButton {
        required property string modelData
        property string kind
        width: list.width
        text: modelData
        checked: panel.code.view.kind === kind && panel.code.view.title === modelData
        onClicked: panel.code.open(kind, modelData)
    }

    RowLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Theme.gap

        ColumnLayout {
            Layout.preferredWidth: Math.round(150 * Theme.scale)
            Layout.maximumWidth: Math.round(150 * Theme.scale)
            Layout.fillHeight: true
            spacing: Theme.tight

            Flickable {
                id: list
                objectName: "canvasPrograms"
                Layout.fillWidth: true
                Layout.fillHeight: true
                clip: true
                contentHeight: entries.height
                boundsBehavior: Flickable.StopAtBounds
                Column {
                    id: entries
                    width: list.width
                    spacing: Math.round(3 * Theme.scale)
                    Caption { text: qsTr("Programs"); bottomPadding: Theme.tight }
                    Repeater {
                        model: panel.canvas.view.programs
                        Entry { kind: "program"; objectName: "canvas_program_" + modelData }
                    }
                    Caption { text: qsTr("Nodes of nodes"); topPadding: Theme.gap; bottomPadding: Theme.tight }
                    Repeater {
                        model: panel.graph.view.graphs
                        Entry { kind: "node"; objectName: "canvas_node_" + modelData }
                    }
                }
            }
            EntryField {
                id: fresh
                objectName: "canvasNewName"
                Layout.fillWidth: true
                placeholderText: qsTr("name of a new one")
                Accessible.name: qsTr("Name of a new program, or of a new node that is made of nodes")
            }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                component Begin: ActionButton {
                    property string kind
                    readonly property string _why: fresh.text ? panel.code.whyNotDraw(kind, fresh.text) : "empty"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    Layout.minimumWidth: Theme.touch
                    enabled: _why === ""
                    opacity: enabled ? 1 : 0.45
                    onClicked: { panel.code.beginDrawing(kind, fresh.text); fresh.clear() }
                }
                ActionButton {
                    visible: panel.wired
                    objectName: "copyGraph"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    Layout.minimumWidth: Theme.touch
                    text: qsTr("Copy")
                    enabled: fresh.text !== "" && panel.open && panel.code.whyNotDraw("node", fresh.text) === ""
                    opacity: enabled ? 1 : 0.45
                    Accessible.name: qsTr("New node, a copy of the one that is shown")
                    onClicked: { panel.code.begin(fresh.text, true); fresh.clear() }
                }
                Begin { visible: !panel.wired; objectName: "newProgram"; kind: "program"; text: qsTr("Program"); Accessible.name: qsTr("New program") }
                Begin { objectName: "newGraph"; kind: "node"; text: qsTr("Node"); Accessible.name: qsTr("New node that is made of nodes") }
            }
        }

        ColumnLayout {
            Layout.fillWidth: true
            Layout.fillHeight: true
            spacing: Theme.tight

            RowLayout {
                visible: panel.open
                Layout.fillWidth: true
                spacing: Theme.tight
                Tool {
                    objectName: "canvasAdd"
                    text: qsTr("Add")
                    enabled: panel.can
                    checked: panel.adding
                    Accessible.name: panel.wired ? qsTr("Add a node as a part") : qsTr("Add a state")
                    onClicked: if (panel.wired) panel.adding = !panel.adding; else panel.canvas.add(false)
                }
                Tool { visible: !panel.wired; objectName: "canvasAddWithin"; text: qsTr("Add inside"); enabled: panel.can && panel.some; Accessible.name: qsTr("Add a state in the selected one"); onClicked: panel.canvas.add(true) }
                Tool {
                    objectName: "canvasConnect"
                    text: panel.view.joining ? qsTr("Touch its end") : qsTr("Connect")
                    enabled: panel.can && (panel.wired ? panel.graph.view.port !== "" : panel.some)
                    checked: panel.view.joining
                    Accessible.name: panel.wired ? qsTr("Connect the selected port with the one that is touched next") : qsTr("Connect the selected state with the one that is touched next")
                    onClicked: panel.drawing.joining(!panel.view.joining)
                }
                Tool { visible: !panel.wired; objectName: "canvasNest"; text: qsTr("Nest"); enabled: panel.can && panel.some && panel.canvas.view.way < 0; Accessible.name: qsTr("Put the selected state into a new one"); onClicked: panel.canvas.nest(panel.canvas.view.state.name + "_group") }
                Tool {
                    objectName: "canvasRemove"
                    text: qsTr("Delete")
                    enabled: panel.can && panel.some
                    Accessible.name: panel.wired ? (panel.graph.view.port !== "" ? qsTr("Delete what the selected port gets") : qsTr("Delete the selected part"))
                        : panel.canvas.view.way < 0 ? qsTr("Delete the selected state") : qsTr("Delete the selected way")
                    onClicked: panel.drawing.remove()
                }
                Item { Layout.fillWidth: true }
                Tool { objectName: "canvasUndo"; text: qsTr("Undo"); enabled: panel.view.undo; onClicked: panel.drawing.undo() }
                Tool { objectName: "canvasRedo"; text: qsTr("Redo"); enabled: panel.view.redo; onClicked: panel.drawing.redo() }
            }
            Item {
                Layout.fillWidth: true
                Layout.fillHeight: true
                Loader {
                    id: ground
                    anchors.fill: parent
                    sourceComponent: panel.wired ? parts : states
                }
                Component {
                    id: states
                    CanvasGround {
                        id: program
                        canvas: panel.canvas
                        opened: panel.code.view.current
                        can: panel.can
                        name: qsTr("The program's states; the arrow keys go from one to the next")
                        Repeater {
                            model: panel.canvas.boxes
                            CanvasBox {
                                zoom: program.zoom
                                joining: panel.canvas.view.joining && !selected
                                onTouched: panel.canvas.touch(name)
                                onJoined: (x, y) => panel.canvas.join(name, x, y)
                            }
                        }
                    }
                }
                Component {
                    id: parts
                    CanvasGround {
                        id: net
                        canvas: panel.graph
                        opened: panel.code.view.current
                        can: panel.can
                        name: qsTr("The node's parts; the arrow keys go from one to the next")
                        Repeater {
                            model: panel.graph.boxes
                            GraphBox { zoom: net.zoom; onTouched: panel.graph.touch(name) }
                        }
                        Repeater {
                            model: panel.graph.sockets
                            GraphPort {
                                zoom: net.zoom
                                can: panel.can
                                aimed: panel.graph.view.joining && !selected
                                onJoined: (x, y) => panel.graph.join(box, port, out, x, y)
                            }
                        }
                    }
                }
                Text {
                    objectName: "canvasEmpty"
                    anchors { fill: parent; margins: Theme.gap }
                    visible: !panel.view.there
                    text: panel.view.problem ? panel.view.problem
                        : panel.open ? ""
                        : panel.code.view.current && (panel.code.view.kind === "program" || panel.wired) ? qsTr("%1 is being fetched …").arg(panel.code.view.title)
                        : qsTr("Choose on the left a program, to see its states, or a node that is made of nodes, to see its parts, and edit them; or begin a new one. What is saved is checked by the engine first, a run goes on in it, and it can be rolled back under Library, Engines' code.")
                    color: panel.view.problem ? Theme.danger : Theme.muted
                    font.pixelSize: Theme.body
                    wrapMode: Text.Wrap
                }
                Text {
                    objectName: "graphEmpty"
                    anchors { fill: parent; margins: Theme.gap }
                    visible: panel.wired && panel.view.there && panel.graph.view.parts === 0
                    text: qsTr("It has no parts yet: press Add, and choose a node of the library.")
                    color: Theme.muted
                    font.pixelSize: Theme.body
                    wrapMode: Text.Wrap
                }
            }
            Text {
                objectName: "canvasSaid"
                visible: text !== ""
                Layout.fillWidth: true
                text: panel.view.said || (panel.view.there && panel.view.problem ? qsTr("Not drawn as it stands: %1").arg(panel.view.problem)
                    : panel.open && panel.code.view.problem.message ? panel.code.view.problem.message : "")
                textFormat: Text.PlainText
                color: Theme.danger
                font.pixelSize: Theme.small
                wrapMode: Text.Wrap
                maximumLineCount: 4
                elide: Text.ElideRight
            }
        }

        ColumnLayout {
            visible: panel.open
            Layout.preferredWidth: Math.round(290 * Theme.scale)
            Layout.maximumWidth: Math.round(290 * Theme.scale)
            Layout.fillHeight: true
            spacing: Theme.tight

            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                Column {
                    Layout.fillWidth: true
                    Text { width: parent.width; text: panel.code.view.title; color: Theme.text; font { pixelSize: Theme.large; weight: Font.DemiBold } elide: Text.ElideMiddle }
                    Text {
                        objectName: "canvasState"
                        width: parent.width
                        text: panel.code.view.readOnly ? qsTr("built in: read only") : panel.code.view.dirty ? qsTr("not saved") : panel.code.view.release > 0 ? qsTr("saved as release %1").arg(panel.code.view.release) : panel.view.running ? qsTr("running") : qsTr("as the engine has it")
                        color: panel.code.view.dirty ? Theme.warning : Theme.muted
                        font.pixelSize: Theme.small
                        elide: Text.ElideRight
                    }
                }
                ActionButton {
                    objectName: "canvasSave"
                    Layout.minimumWidth: Math.round(104 * Theme.scale)
                    tone: "primary"
                    text: qsTr("Save")
                    why: Words.why(panel.code.view.whySave)
                    onClicked: panel.code.save("")
                }
            }
            RowLayout {
                visible: panel.code.view.theirs
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton { objectName: "canvasTheirs"; Layout.fillWidth: true; text: qsTr("Take theirs"); onClicked: panel.code.revert() }
                ActionButton { objectName: "canvasMine"; Layout.fillWidth: true; text: qsTr("Keep mine"); onClicked: panel.code.overrule() }
            }
            Loader {
                Layout.fillWidth: true
                Layout.fillHeight: true
                sourceComponent: panel.wired ? partForm : stateForm
            }
            Component {
                id: stateForm
                CanvasForm { canvas: panel.canvas }
            }
            Component {
                id: partForm
                GraphForm {
                    graph: panel.graph
                    adding: panel.adding
                    onAdded: panel.adding = false
                    onOpened: (node, wired) => {
                        panel.code.open("node", node)
                        if (!wired) Pages.open("code")
                    }
                }
            }
        }
    }
}
