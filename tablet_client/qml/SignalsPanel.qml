import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// Plots of what the robot measures: chosen by joint and quantity, live or held, saved as a table.
Panel {
    id: panel

    readonly property var view: desk.signals.view
    readonly property var colors: [Theme.accent, Theme.warning, Theme.good, "#d58cff"]
    property bool choosing: false
    property string joint: ""

    onVisibleChanged: desk.signals.watch(visible)
    Component.onCompleted: desk.signals.watch(visible)

    ColumnLayout {
        anchors { fill: parent; margins: Math.round(16 * Theme.scale) }
        spacing: Theme.gap

        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.tight
            Caption { text: panel.choosing ? qsTr("Choose signals") : qsTr("Signals"); Layout.fillWidth: true }
            ActionButton {
                objectName: "holdSignals"
                visible: !panel.choosing && panel.view.chosen.length > 0
                checked: panel.view.paused
                text: panel.view.paused ? qsTr("Go on") : qsTr("Hold")
                onClicked: desk.signals.pause(!panel.view.paused)
            }
            ActionButton {
                objectName: "saveSignals"
                visible: !panel.choosing && panel.view.chosen.length > 0
                text: qsTr("Save")
                onClicked: desk.signals.save()
            }
            ActionButton {
                objectName: "chooseSignals"
                visible: panel.view.joints.length > 0
                tone: panel.choosing ? "primary" : "plain"
                text: panel.choosing ? qsTr("Done") : qsTr("Choose")
                onClicked: panel.choosing = !panel.choosing
            }
        }

        Text {
            objectName: "signalsSaid"
            visible: panel.view.said.code !== ""
            Layout.fillWidth: true
            text: Words.signals(panel.view.said.code, panel.view.said.text)
            color: panel.view.said.code === "saved" ? Theme.muted : Theme.warning
            font.pixelSize: Theme.small
            wrapMode: Text.WrapAnywhere
        }

        Text {
            visible: !panel.choosing && panel.view.chosen.length === 0
            Layout.fillWidth: true
            text: panel.view.joints.length
                ? qsTr("Nothing is plotted. Choose up to four signals: each shows its last %1 s at once.").arg(panel.view.span)
                : qsTr("Signals show here once the robot answers.")
            color: Theme.muted
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }

        // ------------------------------------------------------------------------------------------------------ plots
        Repeater {
            model: panel.choosing ? 0 : panel.view.chosen.length
            ColumnLayout {
                id: strip
                required property int index
                readonly property string name: panel.view.chosen[index] || ""
                readonly property var shown: panel.view.shown.find(each => each.name === name)
                                             || ({ unit: "", now: "–", low: "", high: "" })

                Layout.fillWidth: true
                Layout.fillHeight: true
                spacing: Math.round(2 * Theme.scale)
                RowLayout {
                    Layout.fillWidth: true
                    Text {
                        Layout.fillWidth: true
                        text: Words.signalName(strip.name)
                        color: panel.colors[strip.index]
                        font.pixelSize: Theme.small
                        elide: Text.ElideMiddle
                    }
                    Text {
                        objectName: "signalNow_" + strip.index
                        text: strip.shown.now + " " + strip.shown.unit
                        color: Theme.text
                        font.pixelSize: Theme.body
                        font.weight: Font.DemiBold
                        font.features: { "tnum": 1 }
                    }
                }
                Rectangle {
                    Layout.fillWidth: true
                    Layout.fillHeight: true
                    Layout.minimumHeight: Math.round(48 * Theme.scale)
                    radius: Theme.tight
                    color: Theme.ground
                    border.color: Theme.line
                    Accessible.role: Accessible.Graphic
                    Accessible.name: qsTr("%1, from %2 to %3 %4 in the last %5 s").arg(Words.signalName(strip.name))
                        .arg(strip.shown.low).arg(strip.shown.high).arg(strip.shown.unit).arg(panel.view.span)
                    Repeater { // every ten seconds
                        model: 2
                        Rectangle {
                            required property int index
                            x: Math.round(parent.width * (index + 1) / 3)
                            width: 1; height: parent.height
                            color: Theme.line
                        }
                    }
                    Trace {
                        objectName: "trace_" + strip.index
                        anchors { fill: parent; margins: 1 }
                        source: desk.signals
                        name: strip.name
                        color: panel.colors[strip.index]
                    }
                    Text {
                        anchors { left: parent.left; top: parent.top; margins: Math.round(3 * Theme.scale) }
                        text: strip.shown.high; color: Theme.faint; font.pixelSize: Math.round(11 * Theme.scale)
                    }
                    Text {
                        anchors { left: parent.left; bottom: parent.bottom; margins: Math.round(3 * Theme.scale) }
                        text: strip.shown.low; color: Theme.faint; font.pixelSize: Math.round(11 * Theme.scale)
                    }
                }
            }
        }
        RowLayout {
            visible: !panel.choosing && panel.view.chosen.length > 0
            Layout.fillWidth: true
            Repeater {
                model: [qsTr("%1 s ago").arg(panel.view.span), panel.view.paused ? qsTr("held") : qsTr("now")]
                Text {
                    required property string modelData
                    required property int index
                    Layout.fillWidth: true
                    horizontalAlignment: index ? Text.AlignRight : Text.AlignLeft
                    text: modelData; color: Theme.faint; font.pixelSize: Math.round(12 * Theme.scale)
                }
            }
        }
        Item { visible: !panel.choosing && panel.view.chosen.length === 0; Layout.fillHeight: true }

        // --------------------------------------------------------------------------------------------------- choosing
        ListView {
            id: joints
            objectName: "signalJoints"
            visible: panel.choosing
            Layout.fillWidth: true
            Layout.fillHeight: true
            clip: true
            spacing: Math.round(4 * Theme.scale)
            boundsBehavior: Flickable.StopAtBounds
            model: panel.choosing ? ["force"].concat(Object.keys(panel.view.ports), panel.view.joints) : []
            Accessible.role: Accessible.List
            Accessible.name: qsTr("Joints, and nodes that run")
            ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }
            delegate: Column {
                id: entry
                required property string modelData
                readonly property bool open: panel.joint === modelData
                readonly property bool node: modelData.startsWith("node:")
                readonly property int count: panel.view.chosen.filter(name => name.startsWith(modelData + ".")).length
                width: joints.width - Theme.gap
                spacing: Math.round(4 * Theme.scale)
                ActionButton {
                    objectName: "signalsOf_" + entry.modelData
                    width: parent.width
                    checked: entry.open
                    text: (entry.modelData === "force" ? qsTr("Force at the tool") : entry.node ? qsTr("Node %1").arg(entry.modelData.slice(5)) : entry.modelData)
                          + (entry.count ? "  ·  " + entry.count : "")
                    onClicked: panel.joint = entry.open ? "" : entry.modelData
                }
                Flow {
                    visible: entry.open
                    width: parent.width
                    spacing: Math.round(4 * Theme.scale)
                    Repeater {
                        model: entry.open ? (entry.modelData === "force" ? ["x", "y", "z"] : entry.node ? panel.view.ports[entry.modelData] || [] : panel.view.quantities) : []
                        ActionButton {
                            required property string modelData
                            readonly property string name: entry.modelData + "." + modelData
                            readonly property bool on: panel.view.chosen.indexOf(name) >= 0
                            objectName: "signal_" + name
                            tone: on ? "primary" : "plain"
                            text: entry.node ? modelData : Words.quantity(modelData)
                            Accessible.checkable: true
                            Accessible.checked: on
                            onClicked: desk.signals.choose(name)
                        }
                    }
                }
            }
        }
    }
}
