import QtQuick
import QtQuick.Layouts
import Handrail

// One of a few, side by side: options are {name, text, more: what a screen reader says}.
RowLayout {
    id: choice

    property var options: []
    property string chosen
    property string prefix
    signal taken(string name)

    spacing: Theme.tight
    Repeater {
        model: choice.options
        ActionButton {
            required property var modelData
            Layout.fillWidth: true
            Layout.preferredWidth: 1
            objectName: choice.prefix + "_" + modelData.name
            text: modelData.text
            checked: choice.chosen === modelData.name
            Accessible.name: modelData.more || text
            Accessible.checkable: true
            Accessible.checked: checked
            onClicked: choice.taken(modelData.name)
        }
    }
}
