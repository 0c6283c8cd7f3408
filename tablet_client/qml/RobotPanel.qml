import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The robot's hands, who commands it, and what would become of it without this window.
Panel {
    id: panel

    readonly property var view: desk.header

    Flickable {
        id: flick
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        clip: true
        contentHeight: column.implicitHeight
        boundsBehavior: Flickable.StopAtBounds
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

        component Line: Text {
            Layout.fillWidth: true
            color: Theme.text; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            Accessible.role: Accessible.StaticText
            Accessible.name: text
        }

        ColumnLayout {
            id: column
            width: flick.width - Theme.tight
            spacing: Theme.gap

            Caption { text: qsTr("Hands") }
            Line { visible: hands.count === 0; color: Theme.muted; text: qsTr("This robot has no gripper.") }
            Repeater {
                id: hands
                model: desk.hands
                ColumnLayout {
                    id: hand
                    required property string name
                    required property real position
                    required property real low
                    required property real high
                    required property var poses
                    required property bool holding
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    ValueSlider {
                        Layout.fillWidth: true
                        kind: "hand"
                        name: hand.name
                        title: Words.name(hand.name) + (hand.holding ? " · " + qsTr("holds something") : "")
                        unit: ""
                        value: hand.position
                        low: hand.low
                        high: hand.high
                        step: 0
                        text: hand.position.toFixed(2)
                        why: panel.view.handWhy
                        property real _wanted: NaN
                        onMoved: number => _wanted = number
                        onFinished: { if (!Number.isNaN(_wanted)) desk.sendHand(hand.name, _wanted); _wanted = NaN }
                    }
                    Flow {
                        Layout.fillWidth: true
                        spacing: Theme.tight
                        Repeater {
                            model: hand.poses
                            ActionButton {
                                required property var modelData
                                objectName: "hand_" + hand.name + "_" + modelData.name
                                text: Words.name(modelData.name)
                                why: Words.why(panel.view.handWhy)
                                Accessible.name: qsTr("%1: %2").arg(Words.name(hand.name)).arg(text)
                                onClicked: desk.sendHand(hand.name, modelData.position)
                            }
                        }
                    }
                }
            }

            Caption { text: qsTr("Who commands") }
            Line {
                objectName: "commander"
                color: panel.view.commandIsMine ? Theme.good : panel.view.commander ? Theme.warning : Theme.muted
                text: panel.view.commandIsMine ? qsTr("You have the command, as %1: nobody else moves the robot.").arg(panel.view.commander)
                    : panel.view.commander ? qsTr("%1 has the command. STOP and Pause work here, too.").arg(panel.view.commander)
                    : qsTr("Whoever is connected may command.")
            }
            ActionButton {
                id: command
                property bool sure: false // that it is taken from somebody
                readonly property bool taken: panel.view.commander !== "" && !panel.view.commandIsMine
                objectName: "takeCommand"
                Layout.fillWidth: true
                tone: sure && taken ? "danger" : "plain"
                text: panel.view.commandIsMine ? qsTr("Return the command")
                    : !taken ? qsTr("Take the command") : sure ? qsTr("Really take it over") : qsTr("Take over from %1").arg(panel.view.commander)
                why: Words.why(panel.view.commandWhy)
                onClicked: {
                    if (panel.view.commandIsMine) desk.returnCommand()
                    else if (!taken || sure) desk.takeCommand(taken)
                    sure = taken && !sure
                }
                Timer { running: command.sure; interval: 3000; onTriggered: command.sure = false }
            }
            Line {
                objectName: "nobodyCommands"
                visible: panel.view.commands.length === 0
                color: Theme.muted
                text: qsTr("No program or script has taken a part of the robot.")
            }
            Repeater {
                model: panel.view.commands
                Line {
                    required property var modelData
                    objectName: "lease_" + modelData.part
                    text: qsTr("%1: %2").arg(Words.name(modelData.part)).arg(modelData.owner)
                }
            }
            Line {
                visible: panel.view.actions.length > 0
                color: Theme.muted
                text: qsTr("Moving now: %1").arg(panel.view.actions.join(", "))
            }

            Caption { text: qsTr("If the link were lost now") }
            Line { objectName: "ifLost"; text: Words.ifLost(panel.view.ifLost) }
            Line { visible: panel.view.commandIsMine; color: Theme.muted; text: qsTr("Ten seconds later the command would be free again.") }

            Caption { text: qsTr("This window") }
            ActionButton {
                objectName: "theme"
                Layout.fillWidth: true
                text: Theme.dark ? qsTr("Light colours") : qsTr("Dark colours")
                onClicked: Theme.dark = !Theme.dark
            }
            ActionButton {
                objectName: "takeTour"
                visible: desk.tour.view.step === ""
                Layout.fillWidth: true
                text: qsTr("Take the tour")
                onClicked: desk.tour.begin()
            }
        }
    }
}
