import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The code of an engine's nodes and the text of its programs: opened from the list, edited, saved as a release.
Panel {
    id: panel

    readonly property var code: desk.workshop.code
    readonly property var view: code.view
    property bool finding: false
    property bool tuning: false // the parameters of what runs of it are shown

    onVisibleChanged: code.watch(visible)
    Component.onCompleted: code.watch(visible)

    component Tool: ActionButton { opacity: enabled || why ? 1 : 0.45 }

    RowLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Theme.gap

        // ------------------------------------------------------------------------------------------------- what there is
        ColumnLayout {
            Layout.preferredWidth: Math.round(196 * Theme.scale)
            Layout.maximumWidth: Math.round(196 * Theme.scale)
            Layout.fillHeight: true
            spacing: Theme.tight

            Flow {
                visible: panel.view.engines.length > 1
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: panel.view.engines
                    ActionButton {
                        required property string modelData
                        required property int index
                        objectName: "codeEngine_" + modelData
                        text: modelData
                        checked: panel.view.engine === modelData || (panel.view.engine === "" && index === 0)
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: desk.library.at(modelData)
                    }
                }
            }
            ListView {
                id: list
                objectName: "codeList"
                Layout.fillWidth: true
                Layout.fillHeight: true
                clip: true
                model: panel.code.entries
                spacing: Math.round(3 * Theme.scale)
                boundsBehavior: Flickable.StopAtBounds
                activeFocusOnTab: false
                Accessible.role: Accessible.List
                Accessible.name: qsTr("Nodes and programs")
                section.property: "kind"
                section.delegate: Caption {
                    required property string section
                    topPadding: Theme.tight
                    bottomPadding: Theme.tight
                    text: section === "node" ? qsTr("Nodes") : qsTr("Programs")
                }
                ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
                delegate: AbstractButton {
                    id: line
                    required property string kind
                    required property string name
                    required property bool builtin
                    required property string problem
                    required property bool current
                    required property bool dirty
                    objectName: "code_" + kind + "_" + name
                    width: list.width - Theme.gap
                    height: Theme.touch
                    focusPolicy: Qt.StrongFocus
                    text: name
                    Accessible.role: Accessible.Button
                    Accessible.name: text
                    Accessible.description: problem || (dirty ? qsTr("not saved") : builtin ? qsTr("comes with Handrail") : "")
                    onClicked: panel.code.open(kind, name)
                    Keys.onReturnPressed: click()
                    Keys.onEnterPressed: click()
                    background: Rectangle {
                        radius: Theme.radius
                        color: line.down ? Theme.pressed : line.current ? Theme.raised : "transparent"
                        border { width: line.visualFocus ? 2 : 1; color: line.visualFocus ? Theme.accent : line.current ? Theme.line : "transparent" }
                    }
                    contentItem: Item {
                        Text {
                            anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; leftMargin: Theme.tight; rightMargin: Theme.gap }
                            text: line.text
                            color: line.problem ? Theme.danger : line.builtin ? Theme.muted : Theme.text
                            font.pixelSize: Theme.body
                            elide: Text.ElideMiddle
                        }
                        Rectangle {
                            visible: line.dirty
                            anchors { right: parent.right; rightMargin: Math.round(8 * Theme.scale); verticalCenter: parent.verticalCenter }
                            width: Math.round(8 * Theme.scale); height: width; radius: width / 2
                            color: Theme.warning
                        }
                    }
                }
            }
            EntryField {
                id: fresh
                objectName: "newNode"
                Layout.fillWidth: true
                placeholderText: qsTr("name of a new node")
                Accessible.name: qsTr("Name of a new node")
                readonly property string why: text ? panel.code.whyNotBegin(text) : " "
                function begin(copy) { if (why === "") { panel.code.begin(text, copy); clear() } }
                Keys.onReturnPressed: begin(false)
                Keys.onEnterPressed: begin(false)
            }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                Tool {
                    objectName: "beginNode"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: qsTr("New")
                    enabled: fresh.why === ""
                    why: fresh.text ? Words.why(fresh.why) : ""
                    Accessible.name: qsTr("New node")
                    onClicked: fresh.begin(false)
                }
                Tool {
                    objectName: "copyNode"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: qsTr("Copy")
                    enabled: fresh.why === "" && panel.view.kind === "node"
                    Accessible.name: qsTr("New node, a copy of the one that is shown")
                    onClicked: fresh.begin(true)
                }
            }
        }

        // ---------------------------------------------------------------------------------------------------- the editor
        ColumnLayout {
            Layout.fillWidth: true
            Layout.fillHeight: true
            spacing: Theme.tight

            RowLayout {
                visible: panel.view.loaded
                Layout.fillWidth: true
                spacing: Theme.tight
                Column {
                    Layout.fillWidth: true
                    Text {
                        width: parent.width
                        text: panel.view.file
                        color: Theme.text
                        font { pixelSize: Theme.large; weight: Font.DemiBold }
                        elide: Text.ElideMiddle
                    }
                    Text {
                        objectName: "codeState"
                        width: parent.width
                        text: panel.view.readOnly ? qsTr("comes with Handrail: read it, or copy it under a name of your own")
                            : panel.view.dirty ? qsTr("not saved") : panel.view.release > 0 ? qsTr("saved as release %1").arg(panel.view.release)
                            : qsTr("as the engine has it")
                        color: panel.view.dirty ? Theme.warning : Theme.muted
                        font.pixelSize: Theme.small
                        elide: Text.ElideRight
                    }
                }
                Tool { objectName: "undoCode"; text: qsTr("Undo"); enabled: editors.current !== null && editors.current.canUndo; onClicked: editors.current.undo() }
                Tool { objectName: "redoCode"; text: qsTr("Redo"); enabled: editors.current !== null && editors.current.canRedo; onClicked: editors.current.redo() }
                ActionButton {
                    objectName: "findCode"
                    text: qsTr("Find")
                    checked: panel.finding
                    onClicked: { panel.finding = !panel.finding; if (panel.finding) search.forceActiveFocus() }
                }
                Tool {
                    id: back
                    property bool sure: false
                    objectName: "revertCode"
                    tone: sure ? "danger" : "plain"
                    text: sure ? qsTr("Really") : qsTr("Revert")
                    enabled: panel.view.dirty
                    Accessible.name: qsTr("Back to what the engine has")
                    onClicked: { if (sure) panel.code.revert(); sure = !sure }
                    Timer { running: back.sure; interval: 3000; onTriggered: back.sure = false }
                }
                ActionButton {
                    objectName: "tuneCode"
                    visible: desk.workshop.nodes.count > 0
                    text: qsTr("Parameters")
                    checked: panel.tuning
                    Accessible.name: qsTr("Parameters of the nodes that run of it")
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: panel.tuning = !panel.tuning
                }
                ActionButton {
                    objectName: "reloadCode"
                    visible: panel.view.reloads > 0
                    text: qsTr("Reload running")
                    onClicked: panel.code.reload()
                }
                ActionButton {
                    objectName: "saveCode"
                    Layout.minimumWidth: Math.round(104 * Theme.scale)
                    tone: "primary"
                    text: qsTr("Save")
                    why: Words.why(panel.view.whySave)
                    onClicked: panel.save()
                }
            }
            RowLayout {
                visible: panel.view.loaded && panel.finding
                Layout.fillWidth: true
                spacing: Theme.tight
                EntryField {
                    id: search
                    objectName: "searchCode"
                    Layout.fillWidth: true
                    placeholderText: qsTr("Find")
                    Accessible.name: qsTr("Find in the text")
                    onTextEdited: panel.find(false, true)
                    Keys.onReturnPressed: event => panel.find((event.modifiers & Qt.ShiftModifier) !== 0, false)
                    Keys.onEnterPressed: event => panel.find((event.modifiers & Qt.ShiftModifier) !== 0, false)
                }
                Tool { objectName: "findBefore"; text: qsTr("Before"); enabled: search.text !== ""; onClicked: panel.find(true, false) }
                Tool { objectName: "findNext"; text: qsTr("Next"); enabled: search.text !== ""; onClicked: panel.find(false, false) }
            }
            RowLayout {
                visible: panel.view.theirs
                Layout.fillWidth: true
                spacing: Theme.tight
                Text {
                    Layout.fillWidth: true
                    text: qsTr("Somebody else has saved this file since. What you have typed is kept.")
                    color: Theme.warning
                    font.pixelSize: Theme.small
                    wrapMode: Text.Wrap
                }
                ActionButton { objectName: "takeTheirs"; text: qsTr("Take theirs"); onClicked: panel.code.revert() }
                ActionButton { objectName: "keepMine"; text: qsTr("Keep mine"); onClicked: panel.code.overrule() }
            }
            Text {
                objectName: "codeSaid"
                visible: panel.view.said !== "" || !panel.view.loaded
                Layout.fillWidth: true
                Layout.fillHeight: !panel.view.loaded
                text: panel.view.said ? panel.view.said
                    : panel.view.current ? qsTr("%1 is being fetched …").arg(panel.view.title)
                    : qsTr("Choose a node or a program on the left to read and edit its text, or begin a new node there. What is saved is checked by the engine first, and can be rolled back under Library, Engines' code.")
                color: panel.view.said ? Theme.danger : Theme.muted
                font.pixelSize: Theme.body
                wrapMode: Text.Wrap
                verticalAlignment: Text.AlignTop
            }
            RowLayout {
                visible: panel.view.loaded
                Layout.fillWidth: true
                Layout.fillHeight: true
                spacing: Theme.gap
                Item {
                    id: editors
                    property var current: null
                    Layout.fillWidth: true
                    Layout.fillHeight: true
                    Repeater {
                        model: panel.code.documents
                        CodeEditor {
                            anchors.fill: parent
                            visible: key === panel.view.current
                            problem: visible ? panel.view.problem : ({ line: 0, message: "", here: true, at: 0 })
                            onVisibleChanged: if (visible) editors.current = this; else if (editors.current === this) editors.current = null
                            Component.onCompleted: if (visible) editors.current = this
                            Component.onDestruction: if (editors.current === this) editors.current = null
                            onSaveAsked: panel.save()
                            onFindAsked: { panel.finding = true; search.forceActiveFocus(); search.selectAll() }
                        }
                    }
                }
                Flickable {
                    id: running
                    visible: panel.tuning && desk.workshop.nodes.count > 0
                    Layout.preferredWidth: Math.round(250 * Theme.scale)
                    Layout.maximumWidth: Math.round(250 * Theme.scale)
                    Layout.fillHeight: true
                    clip: true
                    contentHeight: tuned.implicitHeight
                    boundsBehavior: Flickable.StopAtBounds
                    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
                    RunningNodes { id: tuned; width: running.width - Theme.tight }
                }
            }
            AbstractButton { // leads to the line
                id: strip
                objectName: "codeProblem"
                visible: panel.view.loaded && panel.view.problem.message !== ""
                Layout.fillWidth: true
                implicitHeight: Math.max(Theme.touch, problem.implicitHeight + 2 * Theme.tight)
                focusPolicy: Qt.StrongFocus
                text: (panel.view.problem.line > 0 ? qsTr("Line %1: ").arg(panel.view.problem.line) : "") + panel.view.problem.message
                      + (panel.view.problem.here ? "" : "  " + qsTr("(of what was last tried to be saved)"))
                Accessible.role: Accessible.Button
                Accessible.name: text
                Keys.onReturnPressed: click()
                Keys.onEnterPressed: click()
                onClicked: if (editors.current !== null && panel.view.problem.line > 0) editors.current.goTo(panel.view.problem.at)
                background: Rectangle {
                    radius: Theme.tight
                    color: panel.view.problem.here ? Theme.badGround : Theme.raised
                    border { width: strip.visualFocus ? 2 : 1; color: strip.visualFocus ? Theme.accent : panel.view.problem.here ? Theme.badLine : Theme.line }
                }
                contentItem: Item {
                    implicitHeight: problem.implicitHeight
                    Text {
                        id: problem
                        anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; margins: Theme.gap }
                        text: strip.text
                        textFormat: Text.PlainText
                        color: panel.view.problem.here ? Theme.badText : Theme.muted
                        font.pixelSize: Theme.small
                        wrapMode: Text.Wrap
                        maximumLineCount: 4
                        elide: Text.ElideRight
                    }
                }
            }
            EntryField {
                id: note
                objectName: "noteCode"
                visible: panel.view.loaded && panel.view.dirty && !panel.view.readOnly
                Layout.fillWidth: true
                maximumLength: 400
                placeholderText: qsTr("What for: it is kept with the release")
                Accessible.name: qsTr("What the change is for")
            }
        }
    }

    function save() {
        panel.code.save(note.text)
        note.clear()
    }

    // `typing`: from where the selection begins, so that it grows while one types.
    function find(before, typing) {
        const editor = editors.current
        if (editor === null) return
        editor.show(panel.code.find(panel.view.current, search.text, before || typing ? editor.selectionStart : editor.selectionEnd, before))
    }
}
