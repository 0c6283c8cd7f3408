import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What happened, newest at the bottom; stays where it is while someone reads further up.
Panel {
    ColumnLayout {
        anchors { fill: parent; margins: Math.round(16 * Theme.scale); bottomMargin: Theme.tight }
        spacing: Theme.tight
        Caption { text: qsTr("What happened") }
        ListView {
            id: list
            objectName: "journal"
            property bool following: true

            Layout.fillWidth: true
            Layout.fillHeight: true
            clip: true
            model: desk.journal
            spacing: Math.round(5 * Theme.scale)
            boundsBehavior: Flickable.StopAtBounds
            activeFocusOnTab: true
            keyNavigationEnabled: true
            Accessible.role: Accessible.List
            Accessible.name: qsTr("What happened")
            onMovementEnded: following = atYEnd
            onCountChanged: if (following) Qt.callLater(positionViewAtEnd)
            onHeightChanged: if (following) Qt.callLater(positionViewAtEnd)
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

            delegate: RowLayout {
                required property string clock
                required property string level
                required property string code
                required property var details
                readonly property string line: Words.entry(code, details)

                width: list.width - Theme.tight
                spacing: Theme.tight
                Accessible.role: Accessible.ListItem
                Accessible.name: line
                Text {
                    Layout.alignment: Qt.AlignTop
                    text: clock
                    color: Theme.faint
                    font.pixelSize: Math.round(12 * Theme.scale)
                    font.features: { "tnum": 1 }
                }
                Text {
                    Layout.fillWidth: true
                    text: line
                    color: level === "info" ? Theme.muted : Theme.state(level)
                    font.pixelSize: Theme.small
                    wrapMode: Text.Wrap
                    maximumLineCount: 3
                    elide: Text.ElideRight
                }
            }
        }
    }
}
