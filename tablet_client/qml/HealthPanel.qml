import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// How the link is, how the robot's processes are, what a chosen one said last, and starting it anew.
Panel {
    id: panel

    readonly property var view: desk.health.view
    readonly property var link: desk.health.link

    onVisibleChanged: desk.health.watch(visible)
    Component.onCompleted: desk.health.watch(visible)
    Component.onDestruction: desk.health.watch(false)

    component Line: Text {
        Layout.fillWidth: true
        color: Theme.text; font.pixelSize: Theme.small; wrapMode: Text.Wrap
        Accessible.role: Accessible.StaticText
        Accessible.name: text
    }
    component Pair: RowLayout {
        property string label
        property string value
        Layout.fillWidth: true
        Text { text: parent.label; color: Theme.muted; font.pixelSize: Theme.small; Layout.fillWidth: true }
        Text { text: parent.value; color: Theme.text; font.pixelSize: Theme.small; font.features: { "tnum": 1 }
               Accessible.role: Accessible.StaticText; Accessible.name: parent.label + ": " + text }
    }

    RowLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Math.round(18 * Theme.scale)

        Flickable {
            id: flick
            Layout.fillHeight: true
            Layout.fillWidth: true
            Layout.preferredWidth: panel.width * 0.5
            clip: true
            contentHeight: column.implicitHeight
            boundsBehavior: Flickable.StopAtBounds
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

            ColumnLayout {
                id: column
                width: flick.width - Theme.tight
                spacing: Theme.tight

                Caption { text: qsTr("Link") }
                Chip {
                    objectName: "quality"
                    text: desk.header.link === "attached" ? Words.quality(panel.link.quality) : Words.link(desk.header.link)
                    color: desk.header.link === "attached" ? Words.qualityColor(panel.link.quality) : Theme.danger
                    detail: desk.header.address
                }
                Pair { label: qsTr("There and back"); value: qsTr("%1, at worst %2").arg(Words.milliseconds(panel.link.latency)).arg(Words.milliseconds(panel.link.worst)) }
                Pair { label: qsTr("Not answered in time"); value: qsTr("%1 %").arg(panel.link.loss) }
                Repeater {
                    model: desk.health.classes
                    Pair {
                        required property string name
                        required property real rate
                        label: Words.traffic(name)
                        value: Words.rate(rate)
                    }
                }
                Pair { visible: panel.view.role !== ""; label: qsTr("The robot knows this window as"); value: qsTr("%1, %2").arg(panel.view.me).arg(Words.role(panel.view.role)) }

                Caption { text: qsTr("Processes"); topPadding: Theme.tight }
                Line { visible: !panel.view.known && panel.view.problem === ""; color: Theme.muted; text: desk.header.link === "attached" ? qsTr("Being asked …") : qsTr("Nobody is connected.") }
                Line { objectName: "serviceProblem"; visible: panel.view.problem !== ""; color: Theme.danger; text: panel.view.problem }
                Repeater {
                    model: desk.health.processes
                    AbstractButton {
                        id: row
                        required property string name
                        required property int depth
                        required property string state
                        required property real cpu
                        required property real memory
                        required property int deaths
                        required property bool chosen
                        required property int since
                        readonly property bool well: state === "up"
                        objectName: "process_" + name
                        Layout.fillWidth: true
                        Layout.leftMargin: depth * Math.round(18 * Theme.scale)
                        implicitHeight: Theme.touch
                        enabled: depth === 0
                        focusPolicy: Qt.StrongFocus
                        text: Words.name(name)
                        Accessible.role: Accessible.ListItem
                        Accessible.name: text
                        Accessible.description: Words.processState(state)
                        onClicked: desk.health.choose(name)
                        Keys.onReturnPressed: click()
                        Keys.onEnterPressed: click()
                        background: Rectangle {
                            radius: Theme.tight
                            color: row.chosen || row.down ? Theme.raised : "transparent"
                            border { width: row.visualFocus ? 2 : 0; color: Theme.accent }
                        }
                        contentItem: Item {
                            Rectangle {
                                id: dot
                                x: Theme.tight
                                anchors.verticalCenter: parent.verticalCenter
                                width: Math.round(9 * Theme.scale); height: width; radius: width / 2
                                color: row.well ? Theme.good : row.state === "starting" || row.state === "waiting" ? Theme.warning : Theme.danger
                            }
                            Column {
                                anchors { left: dot.right; leftMargin: Theme.gap; right: figures.left; verticalCenter: parent.verticalCenter }
                                Text { width: parent.width; elide: Text.ElideRight; text: row.text; color: row.depth ? Theme.muted : Theme.text; font.pixelSize: Theme.small; font.weight: Font.Medium }
                                Text {
                                    visible: !row.well || row.deaths > 0
                                    width: parent.width; elide: Text.ElideRight
                                    text: (row.well ? qsTr("up for %n min", "", row.since) : Words.processState(row.state))
                                          + (row.deaths > 0 ? " · " + (row.deaths === 1 ? qsTr("died once") : qsTr("died %1 times").arg(row.deaths)) : "")
                                    color: row.well ? Theme.muted : Theme.danger
                                    font.pixelSize: Math.round(12 * Theme.scale)
                                }
                            }
                            Text {
                                id: figures
                                anchors { right: parent.right; rightMargin: Theme.tight; verticalCenter: parent.verticalCenter }
                                visible: row.memory > 0
                                text: qsTr("%1 %   %2 MB").arg(row.cpu.toFixed(0)).arg(row.memory.toFixed(0))
                                color: Theme.muted
                                font.pixelSize: Theme.small
                                font.features: { "tnum": 1 }
                            }
                        }
                    }
                }
            }
        }
        Rectangle { Layout.fillHeight: true; Layout.preferredWidth: 1; color: Theme.line }
        ColumnLayout {
            Layout.fillHeight: true
            Layout.fillWidth: true
            Layout.preferredWidth: panel.width * 0.5
            spacing: Theme.tight

            Caption { text: panel.view.chosen ? qsTr("What %1 said last").arg(Words.name(panel.view.chosen)) : qsTr("Log") }
            Line { visible: panel.view.chosen === ""; color: Theme.muted; text: qsTr("Choose a process to read what it said last, or to start it anew.") }
            Flickable {
                id: log
                visible: panel.view.chosen !== ""
                Layout.fillWidth: true
                Layout.fillHeight: true
                clip: true
                contentHeight: text.implicitHeight
                boundsBehavior: Flickable.StopAtBounds
                ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
                // The newest line in sight, unless somebody reads further up.
                property bool follows: true
                onMovementEnded: follows = atYEnd
                onContentHeightChanged: if (follows) contentY = Math.max(0, contentHeight - height)
                onHeightChanged: if (follows) contentY = Math.max(0, contentHeight - height)
                TextEdit {
                    id: text
                    objectName: "processLog"
                    width: log.width - Theme.tight
                    readOnly: true
                    selectByMouse: true
                    activeFocusOnTab: false
                    wrapMode: TextEdit.Wrap
                    textFormat: TextEdit.PlainText
                    text: panel.view.log
                    color: Theme.text
                    font.family: "DejaVu Sans Mono, Consolas, Menlo, monospace"
                    font.pixelSize: Math.round(12 * Theme.scale)
                    Accessible.role: Accessible.EditableText
                    Accessible.name: qsTr("Log")
                }
            }
            Item { visible: panel.view.chosen === ""; Layout.fillHeight: true }
            // Asked twice; what it would do stands above the second question.
            Line {
                objectName: "restarting"
                visible: restart.sure && restart.visible
                color: Theme.warning
                text: Words.restarting(panel.view.kind)
            }
            ActionButton {
                id: restart
                property bool sure: false
                readonly property string process: panel.view.chosen
                objectName: "restart"
                visible: process !== ""
                Layout.fillWidth: true
                tone: sure ? "danger" : "plain"
                text: sure ? qsTr("Really start %1 anew").arg(Words.name(process)) : qsTr("Start anew …")
                why: Words.why(panel.view.why)
                onProcessChanged: sure = false
                onClicked: { if (sure) desk.health.restart(process); sure = !sure }
                Timer { running: restart.sure; interval: 10000; onTriggered: restart.sure = false }
            }
        }
    }
}
