import QtQuick
import Handrail

// A command line to type elsewhere.
Rectangle {
    id: box

    property alias text: line.text

    implicitWidth: line.implicitWidth + 2 * Theme.gap
    implicitHeight: line.implicitHeight + 2 * Theme.tight
    radius: Theme.tight
    color: Theme.ground
    border.color: Theme.line

    TextEdit {
        id: line
        anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter
                  leftMargin: Theme.gap; rightMargin: Theme.gap }
        readOnly: true
        selectByMouse: true
        activeFocusOnTab: false
        wrapMode: TextEdit.Wrap
        color: Theme.code
        font.family: "DejaVu Sans Mono, Consolas, Menlo, monospace"
        font.pixelSize: Theme.small
        Accessible.name: text
    }
}
