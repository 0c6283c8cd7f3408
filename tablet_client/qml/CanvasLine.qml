import QtQuick
import QtQuick.Controls.Basic
import Handrail

// A field of what is selected on the canvas, typed as it stands in the file: it counts when one leaves it or presses Enter.
Column {
    id: line

    property string field
    property string label
    property string value
    property string hint
    property bool locked: false
    signal entered(string typed)

    spacing: Math.round(2 * Theme.scale)

    Text { text: line.label; color: Theme.muted; font.pixelSize: Theme.small }
    EntryField {
        id: entry
        objectName: "canvas_" + line.field
        width: parent.width
        readOnly: line.locked
        placeholderText: line.hint
        Accessible.name: line.label
        property bool typed: false
        onTextEdited: typed = true
        function finish() {
            if (!typed) return
            const given = text
            typed = false // from here on it shows what is so
            line.entered(given)
        }
        onActiveFocusChanged: if (!activeFocus) finish()
        Keys.onReturnPressed: finish()
        Keys.onEnterPressed: finish()
        Binding on text { when: !entry.typed; value: line.value; restoreMode: Binding.RestoreNone }
    }
}
