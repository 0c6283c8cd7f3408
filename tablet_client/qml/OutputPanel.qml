import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What engines, nodes and the daemon say, as it comes: by level and by who says it. Only what is chosen comes over the link.
Panel {
    id: panel

    readonly property var view: desk.workshop.output.view

    onVisibleChanged: desk.workshop.output.watch(visible)
    Component.onCompleted: desk.workshop.output.watch(visible)

    function level(name) {
        return ({ info: qsTr("Info"), warning: qsTr("Warnings"), error: qsTr("Errors") })[name] || name
    }

    ColumnLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale); bottomMargin: Theme.tight }
        spacing: Theme.tight

        Flow {
            Layout.fillWidth: true
            spacing: Theme.tight
            Repeater {
                model: panel.view.levels
                ActionButton {
                    required property var modelData
                    objectName: "level_" + modelData.name
                    text: panel.level(modelData.name)
                    checked: modelData.on
                    Accessible.role: Accessible.CheckBox
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.workshop.output.switch(modelData.name)
                }
            }
            TextField {
                id: search
                objectName: "searchOutput"
                width: Math.round(190 * Theme.scale)
                height: Theme.touch
                color: Theme.text
                placeholderText: qsTr("Search")
                placeholderTextColor: Theme.faint
                font.pixelSize: Theme.body
                Accessible.role: Accessible.EditableText
                Accessible.name: qsTr("Search the output")
                onTextEdited: desk.workshop.output.find(text)
                Keys.onEscapePressed: desk.stop()
                background: Rectangle {
                    radius: Theme.tight
                    color: Theme.ground
                    border { width: search.activeFocus ? 2 : 1; color: search.activeFocus ? Theme.accent : Theme.line }
                }
            }
            ActionButton {
                objectName: "holdOutput"
                text: panel.view.held ? qsTr("Go on (%1)").arg(panel.view.waiting) : qsTr("Hold")
                checked: panel.view.held
                onClicked: desk.workshop.output.hold(!panel.view.held)
            }
            ActionButton { objectName: "copyOutput"; text: qsTr("Copy"); enabled: list.count > 0; onClicked: desk.workshop.output.copy() }
            ActionButton { objectName: "saveOutput"; text: qsTr("Save"); enabled: list.count > 0; onClicked: desk.workshop.output.save() }
            ActionButton { objectName: "clearOutput"; text: qsTr("Clear"); enabled: panel.view.kept > 0; onClicked: desk.workshop.output.clear() }
        }
        Flow {
            Layout.fillWidth: true
            spacing: Theme.tight
            ActionButton {
                objectName: "source_all"
                text: qsTr("All sources")
                checked: panel.view.all
                Accessible.checkable: true
                Accessible.checked: checked
                onClicked: desk.workshop.output.choose("")
            }
            Repeater {
                model: panel.view.sources
                ActionButton {
                    required property var modelData
                    objectName: "source_" + modelData.name
                    text: modelData.lines ? qsTr("%1  %2").arg(modelData.name).arg(modelData.lines) : modelData.name
                    checked: modelData.chosen
                    Accessible.name: qsTr("%1, %n line(s)", "", modelData.lines).arg(modelData.name)
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.workshop.output.choose(modelData.name)
                }
            }
        }
        Text {
            objectName: "outputSaid"
            visible: text !== ""
            Layout.fillWidth: true
            text: panel.view.said.code === "copied" ? qsTr("%n line(s) copied", "", Number(panel.view.said.text))
                : Words.signals(panel.view.said.code, panel.view.said.text)
            color: panel.view.said.code === "not_saved" ? Theme.warning : Theme.muted
            font.pixelSize: Theme.small
            wrapMode: Text.WrapAnywhere
        }
        Text {
            visible: list.count === 0
            Layout.fillWidth: true
            text: panel.view.kept > 0 ? qsTr("Nothing of what has come passes this filter.")
                : qsTr("Nothing has been said yet. Warnings and errors always come; what programs and nodes print comes while Info is on.")
            color: Theme.muted
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }
        ListView {
            id: list
            objectName: "output"
            property bool following: true

            Layout.fillWidth: true
            Layout.fillHeight: true
            clip: true
            model: desk.workshop.output.lines
            spacing: Math.round(3 * Theme.scale)
            boundsBehavior: Flickable.StopAtBounds
            activeFocusOnTab: true
            keyNavigationEnabled: true
            reuseItems: true
            Accessible.role: Accessible.List
            Accessible.name: qsTr("Output")
            onMovementEnded: following = atYEnd
            onCountChanged: if (following) Qt.callLater(positionViewAtEnd)
            onHeightChanged: if (following) Qt.callLater(positionViewAtEnd)
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

            delegate: RowLayout {
                id: row
                required property string clock
                required property string level
                required property string source
                required property string text

                width: list.width - Theme.gap
                spacing: Theme.gap
                Accessible.role: Accessible.ListItem
                Accessible.name: source + ": " + text
                Text {
                    Layout.alignment: Qt.AlignTop
                    text: row.clock
                    color: Theme.faint
                    font.pixelSize: Theme.small
                    font.features: { "tnum": 1 }
                }
                Text {
                    Layout.alignment: Qt.AlignTop
                    Layout.preferredWidth: Math.round(118 * Theme.scale)
                    text: row.source
                    textFormat: Text.PlainText
                    color: Theme.muted
                    font.pixelSize: Theme.small
                    elide: Text.ElideMiddle
                }
                Text {
                    Layout.fillWidth: true
                    text: row.text
                    textFormat: Text.PlainText
                    color: row.level === "info" ? Theme.text : Theme.state(row.level)
                    font { pixelSize: Theme.small; family: "monospace" }
                    wrapMode: Text.WrapAtWordBoundaryOrAnywhere
                    maximumLineCount: 40
                    elide: Text.ElideRight
                }
            }
        }
    }
}
