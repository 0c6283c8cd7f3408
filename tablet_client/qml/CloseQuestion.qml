import QtQuick
import QtQuick.Layouts
import Handrail

// What was typed and not saved would be lost with the window: it is asked about before.
Rectangle {
    id: question

    property int unsaved: 0
    signal closeAnyway()

    objectName: "closeQuestion"
    visible: false
    z: 2
    width: Math.min(parent.width - 4 * Theme.gap, Math.round(520 * Theme.scale))
    height: column.implicitHeight + 4 * Theme.gap
    radius: Theme.radius
    color: Theme.asks
    border { color: Theme.warning; width: 2 }
    Accessible.role: Accessible.Dialog
    Accessible.name: title.text

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; margins: 2 * Theme.gap }
        spacing: Theme.gap
        Text {
            id: title
            Layout.fillWidth: true
            text: qsTr("%n file(s) have edits that were not saved", "", question.unsaved)
            color: Theme.text
            font { pixelSize: Theme.title; weight: Font.DemiBold }
            wrapMode: Text.Wrap
        }
        Text {
            Layout.fillWidth: true
            text: qsTr("They would be lost with this window. The robot goes on as it does; what losing this window does to it stands under Robot.")
            color: Theme.muted
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }
        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.gap
            ActionButton {
                objectName: "keepOpen"
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                tone: "primary"
                text: qsTr("Go and save them")
                onClicked: { question.visible = false; Pages.open("code") }
            }
            ActionButton {
                objectName: "closeAnyway"
                Layout.fillWidth: true
                Layout.preferredWidth: 1
                tone: "danger"
                text: qsTr("Close and lose them")
                onClicked: question.closeAnyway()
            }
        }
    }
}
