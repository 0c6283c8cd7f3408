import QtQuick
import QtQuick.Controls.Basic
import Handrail

// A line to type in. Escape is STOP here, too; Space is not.
TextField {
    id: field
    height: Theme.touch
    implicitHeight: Theme.touch
    color: Theme.text
    placeholderTextColor: Theme.faint
    font.pixelSize: Theme.body
    selectByMouse: true
    Accessible.role: Accessible.EditableText
    Keys.onEscapePressed: desk.stop()
    background: Rectangle {
        radius: Theme.tight
        color: Theme.ground
        border { width: field.activeFocus ? 2 : 1; color: field.activeFocus ? Theme.accent : Theme.line }
    }
}
