import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The robot's address and the code that it shows, typed once: then the two know each other.
ColumnLayout {
    id: contact

    readonly property var view: desk.pairing.view
    readonly property bool busy: view.state === "pairing"

    objectName: "firstContact"
    spacing: Theme.tight

    component Field: TextField {
        id: input
        Layout.preferredHeight: Theme.touch
        color: Theme.text
        placeholderTextColor: Theme.faint
        font.pixelSize: Theme.body
        selectByMouse: true
        Accessible.role: Accessible.EditableText
        Accessible.name: placeholderText
        Keys.onEscapePressed: desk.stop()
        Keys.onReturnPressed: go.click()
        Keys.onEnterPressed: go.click()
        background: Rectangle {
            radius: Theme.tight
            color: Theme.ground
            border { width: input.activeFocus ? 2 : 1; color: input.activeFocus ? Theme.accent : Theme.line }
        }
    }

    RowLayout {
        Layout.fillWidth: true
        spacing: Theme.tight
        Field {
            id: address
            objectName: "pairAddress"
            Layout.fillWidth: true
            Component.onCompleted: text = desk.header.address // not bound: it is typed over
            placeholderText: qsTr("Robot's address")
            inputMethodHints: Qt.ImhUrlCharactersOnly | Qt.ImhNoPredictiveText
        }
        Field {
            id: code
            objectName: "pairCode"
            Layout.preferredWidth: Math.round(150 * Theme.scale)
            placeholderText: qsTr("Code")
            font.capitalization: Font.AllUppercase
            font.family: "DejaVu Sans Mono, Consolas, Menlo, monospace"
            inputMethodHints: Qt.ImhNoPredictiveText | Qt.ImhUppercaseOnly | Qt.ImhSensitiveData
        }
        ActionButton {
            id: go
            objectName: "pair"
            tone: "primary"
            text: qsTr("Pair")
            why: contact.busy ? qsTr("sending …") : ""
            Accessible.name: qsTr("Pair with the robot")
            onClicked: desk.pairing.pair(address.text, code.text)
        }
    }
    Text {
        objectName: "pairSaid"
        visible: text !== ""
        Layout.fillWidth: true
        text: contact.view.state === "paired" ? qsTr("Paired, as %1. Connecting.").arg(Words.role(contact.view.role)) : contact.view.why
        color: contact.view.state === "paired" ? Theme.good : Theme.danger
        font.pixelSize: Theme.small
        wrapMode: Text.Wrap
        Accessible.role: Accessible.StaticText
        Accessible.name: text
    }
}
