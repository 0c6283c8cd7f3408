import QtQuick
import Handrail

// A state in a word or two, with a dot in its colour.
Item {
    id: chip

    property string text
    property string detail
    property color color: Theme.muted

    implicitWidth: row.implicitWidth
    implicitHeight: row.implicitHeight
    Accessible.role: Accessible.StaticText
    Accessible.name: detail ? text + ", " + detail : text

    Row {
        id: row
        spacing: Math.round(9 * Theme.scale)
        Rectangle {
            width: Math.round(10 * Theme.scale); height: width; radius: width / 2
            color: chip.color
            anchors.verticalCenter: parent.verticalCenter
        }
        Column {
            anchors.verticalCenter: parent.verticalCenter
            Text { text: chip.text; color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium }
            Text {
                visible: chip.detail !== ""
                text: chip.detail
                color: Theme.muted
                font.pixelSize: Math.round(12 * Theme.scale)
                width: Math.min(implicitWidth, Math.round(190 * Theme.scale))
                elide: Text.ElideRight
            }
        }
    }
}
