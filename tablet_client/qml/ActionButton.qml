import QtQuick
import QtQuick.Controls.Basic
import Handrail

// A button for a finger. When it can't be used it says why, on itself. Enter presses it (Space is STOP everywhere).
AbstractButton {
    id: button

    property string why: "" // why it can't be pressed; empty when it can
    property string tone: "plain" // plain, primary, danger
    property bool big: false
    property bool held: false // does not react yet, though it looks as it will

    readonly property color _fill: !_usable ? Theme.panel
        : tone === "primary" ? (down ? Qt.darker(Theme.accentDeep, 1.25) : Theme.accentDeep)
        : tone === "danger" ? (down ? Theme.endPressed : Theme.endGround)
        : down || checked ? Theme.pressed : Theme.raised

    enabled: why === "" && !held
    readonly property bool _usable: why === ""
    implicitHeight: big ? Math.round(64 * Theme.scale) : Theme.touch
    implicitWidth: Math.max(implicitHeight, content.implicitWidth + 2 * Theme.gap)
    focusPolicy: Qt.StrongFocus

    Accessible.role: Accessible.Button
    Accessible.name: text
    Accessible.description: why

    Keys.onReturnPressed: click()
    Keys.onEnterPressed: click()

    background: Rectangle {
        radius: Theme.radius
        color: button._fill
        border.width: button.visualFocus ? 2 : 1
        border.color: button.visualFocus ? Theme.accent
            : button.checked ? Theme.accent : !button._usable ? Theme.line
            : button.tone === "primary" ? Theme.accent
            : button.tone === "danger" ? Theme.badLine : Theme.line
    }

    contentItem: Item {
        Column {
            id: content
            anchors.centerIn: parent
            Text {
                anchors.horizontalCenter: parent.horizontalCenter
                text: button.text
                color: button._usable ? (button.tone === "danger" ? Theme.badText : button.tone === "primary" ? Theme.textOnAccent : Theme.text) : Theme.faint
                font.pixelSize: button.big ? Theme.large : Theme.body
                font.weight: button.tone === "plain" ? Font.Medium : Font.DemiBold
            }
            Text {
                anchors.horizontalCenter: parent.horizontalCenter
                visible: button.why !== ""
                text: button.why
                color: Theme.faint
                font.pixelSize: Math.round(11.5 * Theme.scale)
                width: Math.min(implicitWidth, button.width - Theme.tight)
                elide: Text.ElideRight
            }
        }
    }
}
