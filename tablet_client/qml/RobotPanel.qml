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
                objectName: "nobodyCommands"
                visible: panel.view.commands.length === 0
                color: Theme.muted
                text: qsTr("Nobody has taken a part of the robot: whoever is connected may command it.")
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
