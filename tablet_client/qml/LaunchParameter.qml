import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// A program's parameter, or a node's: a number with its unit and, where it has bounds, a slider; a switch; one of a few words; or words.
ColumnLayout {
    id: item

    required property string name
    required property string title
    required property string type
    required property string unit
    required property var value
    required property real low
    required property real high
    required property bool bounded
    required property real step
    required property bool fits
    required property string expected
    required property var choices
    property string kind: "given" // what its controls' names begin with
    signal turned(real number)
    signal switched(bool on)
    signal written(string text)
    readonly property string label: title || Words.name(name)
    readonly property bool isNumber: type === "number" || type === "integer"

    spacing: Theme.tight / 2

    Text { Layout.fillWidth: true; text: item.label; color: Theme.text; font.pixelSize: Theme.small; wrapMode: Text.Wrap }
    RowLayout {
        visible: item.isNumber
        Layout.fillWidth: true
        spacing: Theme.gap
        ValueSlider {
            visible: item.bounded
            Layout.fillWidth: true
            kind: item.kind
            titled: false
            name: item.name
            title: item.name
            unit: item.unit
            value: item.isNumber && item.value !== null ? item.value : 0
            low: item.low
            high: item.high
            step: item.step
            text: item.expected
            onMoved: number => item.turned(number)
        }
        NumberField {
            Layout.preferredWidth: Math.round(104 * Theme.scale)
            Layout.fillWidth: !item.bounded
            name: item.name
            label: ""
            unit: item.unit
            decimals: item.type === "integer" ? 0 : item.bounded && item.high - item.low > 20 ? 1 : 3
            value: item.isNumber && item.value !== null ? item.value : 0
            onEntered: number => item.turned(number)
        }
    }
    ActionButton {
        visible: item.type === "bool"
        objectName: visible ? item.kind + "_" + item.name : ""
        Layout.fillWidth: true
        text: item.value === true ? qsTr("yes") : qsTr("no")
        checked: item.value === true
        Accessible.role: Accessible.CheckBox
        Accessible.name: item.label
        Accessible.checkable: true
        Accessible.checked: checked
        onClicked: item.switched(item.value !== true)
    }
    Choice {
        visible: item.type === "text" && item.choices.length > 0
        Layout.fillWidth: true
        prefix: item.kind + "_" + item.name
        chosen: item.type === "text" && item.value !== null ? item.value : ""
        options: item.choices.map(each => ({ name: each, text: each, more: qsTr("%1: %2").arg(item.label).arg(each) }))
        onTaken: name => item.written(name)
    }
    TextField {
        id: words
        visible: item.type === "text" && item.choices.length === 0
        objectName: visible ? item.kind + "_" + item.name : ""
        Layout.fillWidth: true
        Layout.preferredHeight: Theme.touch
        color: Theme.text
        font.pixelSize: Theme.body
        Accessible.role: Accessible.EditableText
        Accessible.name: item.label
        onTextEdited: item.written(text)
        Binding on text { when: !words.activeFocus; value: item.type === "text" && item.value !== null ? item.value : ""; restoreMode: Binding.RestoreNone }
        Keys.onEscapePressed: desk.stop()
        background: Rectangle {
            radius: Theme.tight
            color: Theme.ground
            border { width: words.activeFocus ? 2 : 1; color: words.activeFocus ? Theme.accent : Theme.line }
        }
    }
    Text {
        visible: !item.fits
        Layout.fillWidth: true
        text: qsTr("expected: %1").arg(item.expected)
        color: Theme.danger; font.pixelSize: Theme.small; wrapMode: Text.Wrap
    }
}
