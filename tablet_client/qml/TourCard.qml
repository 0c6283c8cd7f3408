import QtQuick
import QtQuick.Layouts
import Handrail

// One step of the tour: what to do next, and where.
Rectangle {
    id: card

    readonly property var view: desk.tour.view
    readonly property var words: Words.tour(view.step)

    objectName: "tourCard"
    visible: view.step !== ""
    implicitHeight: visible ? column.implicitHeight + 2 * Theme.gap : 0
    radius: Theme.radius
    color: Theme.asks
    border { color: Theme.accent; width: 1 }
    Accessible.role: Accessible.Grouping
    Accessible.name: qsTr("Tour")

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; top: parent.top; margins: Theme.gap }
        spacing: Theme.tight

        Caption {
            text: card.view.step === "over" ? qsTr("Tour") : qsTr("Tour, %1 of %2").arg(card.view.number).arg(card.view.of)
            color: Theme.accent
        }
        Text {
            objectName: "tourTitle"
            Layout.fillWidth: true
            text: card.words.title
            color: Theme.text
            font { pixelSize: Theme.large; weight: Font.DemiBold }
            wrapMode: Text.Wrap
        }
        Text {
            objectName: "tourText"
            Layout.fillWidth: true
            text: card.words.text
            color: Theme.muted
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
            Accessible.role: Accessible.StaticText
            Accessible.name: text
        }
        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.tight
            ActionButton {
                objectName: "tourEnd"
                visible: card.view.step !== "over"
                text: qsTr("End the tour")
                onClicked: desk.tour.end()
            }
            Item { Layout.fillWidth: true }
            ActionButton {
                objectName: "tourPage"
                readonly property string page: card.words.page || ""
                visible: page !== "" && Pages.current !== page
                text: qsTr("Go there")
                onClicked: Pages.open(page)
            }
            ActionButton {
                objectName: "tourNext"
                tone: card.view.step === "look" || card.view.step === "over" ? "primary" : "plain"
                text: card.view.step === "look" ? qsTr("Done") : card.view.step === "over" ? qsTr("Close") : qsTr("Skip")
                onClicked: desk.tour.next()
            }
        }
    }
}
