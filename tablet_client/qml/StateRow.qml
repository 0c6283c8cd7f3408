import QtQuick
import QtQuick.Controls.Basic
import Handrail

// One state of the program: lit while it is active, with how long it took. A tap opens what can be done with it.
Item {
    id: row

    required property string id
    required property string title
    required property int depth
    required property string does
    required property string mark
    required property real seconds
    required property int visits
    required property bool halts
    required property string outcome
    required property bool chosen

    readonly property color tone: mark === "active" ? Theme.accent : mark === "waiting" ? Theme.warning
        : mark === "failed" ? Theme.danger : mark === "passed" ? Theme.good : Theme.faint

    implicitHeight: line.height + (chosen ? actions.height + Theme.tight : 0)

    AbstractButton {
        id: line
        objectName: "state_" + row.id
        width: parent.width
        height: Theme.touch
        focusPolicy: Qt.StrongFocus
        text: row.title
        Accessible.role: Accessible.TreeItem
        Accessible.name: row.title
        Accessible.description: Words.mark(row.mark) + (row.halts ? ", " + qsTr("breakpoint") : "")
        onClicked: desk.run.choose(row.id)
        Keys.onReturnPressed: click()
        Keys.onEnterPressed: click()

        background: Rectangle {
            radius: Theme.tight
            color: row.mark === "active" || row.mark === "waiting" ? Qt.rgba(row.tone.r, row.tone.g, row.tone.b, 0.16)
                : line.down || row.chosen ? Theme.raised : "transparent"
            border { width: line.visualFocus ? 2 : 0; color: Theme.accent }
        }
        contentItem: Item {
            Rectangle { // a breakpoint
                objectName: "halts_" + row.id
                visible: row.halts
                x: Math.round(2 * Theme.scale)
                anchors.verticalCenter: parent.verticalCenter
                width: Math.round(12 * Theme.scale); height: width; radius: width / 2
                color: Theme.danger
            }
            Rectangle {
                id: dot
                x: Math.round((20 + 16 * row.depth) * Theme.scale)
                anchors.verticalCenter: parent.verticalCenter
                width: Math.round(9 * Theme.scale); height: width
                radius: row.does || row.outcome ? width / 2 : 2
                color: row.mark ? row.tone : "transparent"
                border { width: row.mark ? 0 : 1; color: Theme.faint }
            }
            Text {
                anchors { left: dot.right; leftMargin: Math.round(9 * Theme.scale); right: time.left; rightMargin: Theme.tight
                          verticalCenter: parent.verticalCenter }
                text: row.title
                color: row.mark ? Theme.text : Theme.muted
                font.pixelSize: Theme.small
                font.weight: row.mark === "active" || row.mark === "waiting" ? Font.DemiBold : Font.Normal
                wrapMode: Text.Wrap
                maximumLineCount: 2
                elide: Text.ElideRight
            }
            Text {
                id: time
                objectName: "lasted_" + row.id
                anchors { right: parent.right; rightMargin: Theme.tight; verticalCenter: parent.verticalCenter }
                text: (row.visits > 1 ? qsTr("%1× ").arg(row.visits) : "") + (row.seconds >= 0 ? Words.lasted(row.seconds) : "")
                color: row.mark === "active" ? Theme.accent : Theme.muted
                font.pixelSize: Math.round(12 * Theme.scale)
                font.features: { "tnum": 1 }
            }
        }
    }
    Row {
        id: actions
        visible: row.chosen
        anchors { top: line.bottom; topMargin: Theme.tight / 2; left: parent.left; right: parent.right; leftMargin: Math.round(20 * Theme.scale) }
        spacing: Theme.tight
        ActionButton {
            objectName: "breakpoint"
            width: (parent.width - parent.spacing) / 2
            text: row.halts ? qsTr("Don't pause") : qsTr("Pause before")
            why: row.does ? Words.why(desk.run.view.why.breakpoint) : qsTr("does nothing")
            onClicked: desk.run.breakpoint(row.id)
        }
        ActionButton {
            objectName: "runFrom"
            width: (parent.width - parent.spacing) / 2
            text: qsTr("Run from here")
            why: row.outcome ? qsTr("is an end") : Words.why(desk.run.view.why.from)
            onClicked: desk.run.runFrom(row.id)
        }
    }
}
