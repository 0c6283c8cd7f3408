import QtQuick
import QtQuick.Controls.Basic
import Handrail

// The programs of the engine's library; a tap takes one up.
ListView {
    id: list

    readonly property var view: desk.library.view

    objectName: "programList"
    clip: true
    model: desk.library.programs
    spacing: Theme.tight
    boundsBehavior: Flickable.StopAtBounds
    activeFocusOnTab: false
    Accessible.role: Accessible.List
    Accessible.name: qsTr("Programs")
    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

    header: Text {
        width: list.width
        visible: text !== ""
        height: visible ? implicitHeight + Theme.tight : 0
        text: list.view.problem ? list.view.problem
            : !list.view.known ? qsTr("The engine's programs are listed here as soon as it answers.")
            : list.count === 0 ? qsTr("The engine has no program. Bring it one: handrail deploy PROGRAM") : ""
        color: list.view.problem ? Theme.danger : Theme.muted
        font.pixelSize: Theme.small
        wrapMode: Text.Wrap
    }
    delegate: AbstractButton {
        id: line
        required property string name
        required property string title
        required property string problem
        objectName: "program_" + name
        width: list.width - Theme.tight
        implicitHeight: Math.max(Theme.touch, words.implicitHeight + 2 * Theme.tight)
        focusPolicy: Qt.StrongFocus
        enabled: problem === ""
        text: Words.name(name)
        Accessible.role: Accessible.Button
        Accessible.name: text
        Accessible.description: problem || title
        onClicked: desk.library.choose(name)
        Keys.onReturnPressed: click()
        Keys.onEnterPressed: click()
        background: Rectangle {
            radius: Theme.radius
            color: line.down ? Theme.pressed : Theme.raised
            opacity: line.enabled ? 1 : 0.5
            border { width: line.visualFocus ? 2 : 1; color: line.visualFocus ? Theme.accent : Theme.line }
        }
        contentItem: Item {
            Column {
                id: words
                anchors { left: parent.left; right: parent.right; verticalCenter: parent.verticalCenter; margins: Theme.gap }
                Text { width: parent.width; text: line.title || line.text; color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium; elide: Text.ElideRight }
                Text {
                    width: parent.width
                    text: line.problem ? qsTr("can't be used: %1").arg(line.problem) : line.name
                    color: line.problem ? Theme.danger : Theme.muted
                    font.pixelSize: Theme.small
                    wrapMode: Text.Wrap; maximumLineCount: 3; elide: Text.ElideRight
                }
            }
        }
    }
}
