import QtQuick
import Handrail

// Moves something by hand while it is held, or by a step where it is tapped. Enter goes by a step, or holds as long as it is down.
ActionButton {
    id: button

    required property string what // tx ... rz, or a joint
    required property int sign

    readonly property string _key: what + (sign > 0 ? "+" : "-")

    objectName: "move_" + _key
    checked: desk.move.view.held === _key
    onPressed: desk.move.press(what, sign)
    onReleased: desk.move.letGo()
    onCanceled: desk.move.letGo()
    onVisibleChanged: if (!visible) desk.move.letGo()
    onActiveFocusChanged: if (!activeFocus) desk.move.letGo()
    Keys.onPressed: event => {
        if (event.key !== Qt.Key_Return && event.key !== Qt.Key_Enter) return
        event.accepted = true
        if (!event.isAutoRepeat) desk.move.press(what, sign)
    }
    Keys.onReleased: event => {
        if (event.key !== Qt.Key_Return && event.key !== Qt.Key_Enter) return
        event.accepted = true
        if (!event.isAutoRepeat) desk.move.letGo()
    }
}
