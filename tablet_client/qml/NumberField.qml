import QtQuick
import QtQuick.Controls.Basic
import Handrail

// A number to type in, or to step. Space and Escape are STOP here, too.
Column {
    id: field

    property string label
    property string unit
    property real value: 0
    property int decimals: 1
    property string name: label // accessible
    signal entered(real value)

    spacing: Math.round(2 * Theme.scale)
    Text { text: field.label; color: Theme.muted; font.pixelSize: Math.round(12 * Theme.scale) }
    TextField {
        id: input
        objectName: "number_" + field.name
        width: parent.width
        height: Theme.touch
        leftPadding: Theme.tight + 2
        rightPadding: unit.width + Theme.tight + 4
        color: acceptableInput ? Theme.text : Theme.danger
        font.pixelSize: Theme.body
        font.features: { "tnum": 1 }
        selectByMouse: true
        inputMethodHints: Qt.ImhFormattedNumbersOnly
        validator: RegularExpressionValidator { regularExpression: /^[-+]?[0-9]*[.,]?[0-9]*$/ }
        Accessible.role: Accessible.EditableText
        Accessible.name: field.name + (field.unit ? ", " + field.unit : "")
        onActiveFocusChanged: if (activeFocus) selectAll(); else if (_typed) finish()
        property bool _typed: false
        onTextEdited: _typed = true
        Keys.onReturnPressed: finish()
        Keys.onEnterPressed: finish()
        Keys.onUpPressed: field.entered(field.value + (field.unit === "°" ? 1 : 5))
        Keys.onDownPressed: field.entered(field.value - (field.unit === "°" ? 1 : 5))
        Keys.onSpacePressed: desk.stop()
        Keys.onEscapePressed: desk.stop()
        function finish() {
            const given = text
            const number = Number(given.replace(",", "."))
            _typed = false // from here on it shows what is so
            if (given !== "" && Number.isFinite(number)) field.entered(number)
        }
        Binding on text { when: !input._typed; value: field.value.toFixed(field.decimals); restoreMode: Binding.RestoreNone }
        background: Rectangle {
            radius: Theme.tight
            color: Theme.ground
            border { width: input.activeFocus ? 2 : 1; color: input.activeFocus ? Theme.accent : Theme.line }
        }
        Text {
            id: unit
            anchors { right: parent.right; rightMargin: Theme.tight; verticalCenter: parent.verticalCenter }
            text: field.unit
            color: Theme.faint
            font.pixelSize: Math.round(12 * Theme.scale)
        }
    }
}
