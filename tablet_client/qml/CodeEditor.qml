import QtQuick
import QtQuick.Controls.Basic
import Handrail

// One document's text: numbered lines, colours, and what is wrong at the line where it is. Escape is STOP here, too; Space is not.
Rectangle {
    id: editor

    required property string key
    required property string file
    required property bool readOnly
    required property string name
    property var problem: ({ line: 0, message: "", here: true, at: 0 })

    readonly property alias canUndo: area.canUndo
    readonly property alias canRedo: area.canRedo
    readonly property alias selectionStart: area.selectionStart
    readonly property alias selectionEnd: area.selectionEnd
    signal saveAsked()
    signal findAsked()

    function undo() { area.undo() }
    function redo() { area.redo() }
    // Select what was found.
    function show(found) {
        if (found.start >= 0) { area.select(found.start, found.end); area.reveal() }
    }

    // Put the cursor where something is wrong.
    function goTo(at) {
        area.forceActiveFocus()
        area.cursorPosition = Math.min(at, area.length)
        area.reveal()
    }

    readonly property bool _wrong: problem.line > 0 && problem.here
    readonly property real _line: area.contentHeight / Math.max(1, area.lineCount)

    radius: Theme.tight
    color: Theme.ground
    border { width: area.activeFocus ? 2 : 1; color: area.activeFocus ? Theme.accent : Theme.line }

    Flickable {
        id: flick
        anchors { fill: parent; margins: 2 }
        clip: true
        boundsBehavior: Flickable.StopAtBounds
        contentWidth: Math.max(width, numbers.width + area.implicitWidth + wrong.width + Theme.gap)
        contentHeight: Math.max(height, area.implicitHeight)
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(8 * Theme.scale) }
        ScrollBar.horizontal: ScrollBar { policy: ScrollBar.AsNeeded; height: Math.round(8 * Theme.scale) }

        Rectangle { // the line that is wrong
            visible: editor._wrong
            x: 0
            y: area.y + area.topPadding + (editor.problem.line - 1) * editor._line
            width: flick.contentWidth
            height: editor._line
            color: Theme.badGround
        }
        Text {
            id: numbers
            topPadding: area.topPadding
            leftPadding: Theme.tight
            rightPadding: Theme.gap
            horizontalAlignment: Text.AlignRight
            text: Array.from({ length: area.lineCount }, (_, k) => k + 1).join("\n")
            font: area.font
            color: Theme.faint
            lineHeight: editor._line
            lineHeightMode: Text.FixedHeight
            Accessible.ignored: true
        }
        TextArea {
            id: area
            objectName: "area_" + editor.name
            x: numbers.width
            width: flick.contentWidth - x
            height: flick.contentHeight
            padding: 0
            topPadding: Theme.tight
            bottomPadding: Theme.tight
            readOnly: editor.readOnly
            textFormat: TextEdit.PlainText
            wrapMode: TextEdit.NoWrap
            selectByMouse: true
            persistentSelection: true
            color: Theme.text
            selectionColor: Theme.accentDeep
            selectedTextColor: Theme.textOnAccent
            font { family: "monospace"; pixelSize: Theme.body }
            inputMethodHints: Qt.ImhNoPredictiveText | Qt.ImhNoAutoUppercase
            activeFocusOnTab: true
            background: null
            Accessible.role: Accessible.EditableText
            Accessible.name: qsTr("Text of %1").arg(editor.file)
            Accessible.multiLine: true
            Component.onCompleted: {
                desk.workshop.code.colour(Theme.dark)
                desk.workshop.code.attach(editor.key, textDocument)
                cursorPosition = 0
            }

            function change(how) {
                if (readOnly) return
                const selected = desk.workshop.code.indent(editor.key, how, selectionStart, selectionEnd)
                select(selected.start, selected.end)
            }
            function reveal() {
                const box = cursorRectangle
                const top = y + box.y, left = x + box.x
                flick.contentY = Math.max(Math.min(flick.contentY, top - editor._line), Math.min(top + 2 * editor._line - flick.height, flick.contentHeight - flick.height), 0)
                flick.contentX = Math.max(0, left < flick.contentX + x ? left - x - 40 : Math.max(flick.contentX, left + 40 - flick.width))
            }
            onCursorRectangleChanged: if (activeFocus) reveal()
            Keys.onEscapePressed: desk.stop()
            Keys.onTabPressed: event => { if (readOnly) event.accepted = false; else change("tab") }
            Keys.onBacktabPressed: event => { if (readOnly) event.accepted = false; else change("back") }
            Keys.onReturnPressed: change("enter")
            Keys.onEnterPressed: change("enter")
            Keys.onPressed: event => {
                if (event.matches(StandardKey.Save)) { editor.saveAsked(); event.accepted = true }
                else if (event.matches(StandardKey.Find)) { editor.findAsked(); event.accepted = true }
                else if (event.key === Qt.Key_F6) { nextItemInFocusChain().forceActiveFocus(Qt.TabFocusReason); event.accepted = true } // Tab indents
            }
        }
        Text { // what is wrong, behind its line
            id: wrong
            readonly property rect _end: { area.text; return area.positionToRectangle(Math.min(editor.problem.at, area.length)) }
            visible: editor._wrong
            x: area.x + _end.x + Math.round(24 * Theme.scale)
            y: area.y + area.topPadding + (editor.problem.line - 1) * editor._line
            height: editor._line
            verticalAlignment: Text.AlignVCenter
            text: "← " + editor.problem.message.split("\n")[0]
            textFormat: Text.PlainText
            color: Theme.badText
            font { pixelSize: Theme.small; italic: true }
            Accessible.ignored: true
        }
    }
    Connections {
        target: Theme
        function onDarkChanged() { desk.workshop.code.colour(Theme.dark) }
    }
}
