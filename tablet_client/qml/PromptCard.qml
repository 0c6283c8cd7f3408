import QtQuick
import QtQuick.Layouts
import Handrail

// The robot asks. Large, with the numbers that the decision hangs on, and the reason when an answer is not possible.
Rectangle {
    id: card

    readonly property var view: desk.prompt
    readonly property color tone: view.stale ? Theme.danger : view.severity === "warning" ? Theme.warning : Theme.accent

    // A card that has just come may lie under a finger that was on its way to something else: answers wait a moment.
    readonly property string question: view.open ? view.id : ""
    property bool settled: false
    onQuestionChanged: { settled = false; if (question) settling.restart() }
    Timer { id: settling; interval: 600; onTriggered: card.settled = true }

    objectName: "promptCard"
    visible: view.open
    implicitHeight: visible ? column.implicitHeight + 2 * Theme.gap + Theme.tight : 0
    radius: Theme.radius
    color: Theme.asks
    border { color: tone; width: 2 }
    Accessible.role: Accessible.Grouping
    Accessible.name: qsTr("Question from the robot")

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; top: parent.top; margins: Math.round(16 * Theme.scale) }
        spacing: Theme.gap

        RowLayout {
            Caption { text: card.view.severity === "warning" ? qsTr("Attention") : qsTr("Your decision"); color: card.tone }
            Item { Layout.fillWidth: true }
            Caption { visible: card.view.waiting > 1; text: qsTr("1 of %1").arg(card.view.waiting || 0) }
        }
        Text {
            objectName: "promptText"
            Layout.fillWidth: true
            text: card.view.text || ""
            color: Theme.text
            font.pixelSize: Theme.title
            font.weight: Font.DemiBold
            wrapMode: Text.Wrap
            Accessible.role: Accessible.StaticText
            Accessible.name: text
        }
        GridLayout {
            Layout.fillWidth: true
            columns: Math.max(3, Math.min(4, card.view.details.length))
            columnSpacing: Theme.gap
            rowSpacing: Theme.gap
            visible: card.view.details.length > 0
            Repeater {
                model: card.view.details
                Column {
                    required property var modelData
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    Layout.alignment: Qt.AlignTop
                    Text {
                        objectName: "detail_" + (modelData.code || modelData.label)
                        text: modelData.text
                        color: !modelData.level || modelData.level === "good" ? Theme.text : Words.levelColor(modelData.level)
                        font.pixelSize: Theme.title; font.weight: Font.Medium
                    }
                    Text {
                        text: modelData.code ? Words.figure(modelData.code) : modelData.label; color: Theme.muted; font.pixelSize: Math.round(12 * Theme.scale)
                        width: parent.width; wrapMode: Text.Wrap
                    }
                    Text {
                        visible: !!modelData.where
                        text: modelData.where ? qsTr("to %1").arg(Words.name(modelData.where)) : ""
                        color: Theme.faint; font.pixelSize: Math.round(11.5 * Theme.scale)
                        width: parent.width; elide: Text.ElideRight
                    }
                }
            }
        }
        Text {
            objectName: "staleReason"
            Layout.fillWidth: true
            visible: card.view.stale === true
            text: qsTr("This plan can't be executed any more: %1").arg(card.view.because || "")
            color: Theme.badText
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }
        Text {
            Layout.fillWidth: true
            visible: !!card.view.refused
            text: qsTr("Not taken: %1").arg(card.view.refused || "")
            color: Theme.badText
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }
        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.gap
            Repeater {
                // Answers that let the robot go stand on the right, away from the others.
                model: card.view.options.slice().sort((a, b) => a.go - b.go)
                ActionButton {
                    required property var modelData
                    objectName: "option_" + modelData.option
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    big: true
                    tone: modelData.go ? "primary" : "plain"
                    text: Words.option(modelData.option)
                    why: Words.why(modelData.why)
                    held: !card.settled
                    onClicked: desk.answer(modelData.option)
                }
            }
        }
    }
}
