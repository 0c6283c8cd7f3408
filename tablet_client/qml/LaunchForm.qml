import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// One program before it is run: what it does, what with, its parameters, and its start.
ColumnLayout {
    id: form

    readonly property var view: desk.library.view

    spacing: Theme.gap

    RowLayout {
        Layout.fillWidth: true
        spacing: Theme.gap
        ActionButton {
            objectName: "backToList"
            text: "‹"
            Accessible.name: qsTr("Back to the list of programs")
            onClicked: desk.library.choose("")
        }
        Column {
            Layout.fillWidth: true
            Text { width: parent.width; text: form.view.title || Words.name(form.view.program); color: Theme.text; font.pixelSize: Theme.large; font.weight: Font.DemiBold; elide: Text.ElideRight }
            Text { width: parent.width; text: form.view.program + " · " + form.view.hash; color: Theme.faint; font.pixelSize: Theme.small; elide: Text.ElideRight }
        }
    }

    Flickable {
        id: flick
        objectName: "launchForm"
        Layout.fillWidth: true
        Layout.fillHeight: true
        clip: true
        contentHeight: column.implicitHeight
        boundsBehavior: Flickable.StopAtBounds
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

        ColumnLayout {
            id: column
            width: flick.width - Theme.tight
            spacing: Theme.gap

            Text {
                visible: text !== ""
                Layout.fillWidth: true
                text: form.view.about
                color: Theme.muted; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            }
            Repeater {
                model: desk.library.slots
                ColumnLayout {
                    id: slot
                    required property string name
                    required property string title
                    required property string kind
                    required property string template
                    required property var fitting
                    required property string bound
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    Caption { Layout.fillWidth: true; text: slot.title || Words.name(slot.name); elide: Text.ElideRight }
                    Text {
                        visible: slot.fitting.length === 0
                        Layout.fillWidth: true
                        text: slot.kind === "arm" ? qsTr("This robot has no arm.")
                            : slot.template ? qsTr("No %1 is placed: place one under Objects.").arg(Words.name(slot.template))
                            : qsTr("Nothing is placed: place a template under Objects.")
                        color: Theme.warning; font.pixelSize: Theme.small; wrapMode: Text.Wrap
                    }
                    Flow {
                        Layout.fillWidth: true
                        spacing: Theme.tight
                        Repeater {
                            model: slot.fitting
                            ActionButton {
                                required property string modelData
                                objectName: "bind_" + slot.name + "_" + modelData
                                text: slot.kind === "arm" ? Words.name(modelData) : modelData
                                checked: slot.bound === modelData
                                Accessible.name: qsTr("%1: %2").arg(slot.title || Words.name(slot.name)).arg(text)
                                Accessible.checkable: true
                                Accessible.checked: checked
                                onClicked: desk.library.bind(slot.name, modelData)
                            }
                        }
                    }
                }
            }
            Caption { visible: parameters.count > 0; text: qsTr("Parameters") }
            Repeater {
                id: parameters
                model: desk.library.parameters
                LaunchParameter {
                    Layout.fillWidth: true
                    onTurned: number => desk.library.turn(name, number)
                    onSwitched: on => desk.library.switch(name, on)
                    onWritten: text => desk.library.write(name, text)
                }
            }
            Text {
                objectName: "launchProblem"
                visible: text !== ""
                Layout.fillWidth: true
                text: form.view.problem
                color: Theme.danger; font.pixelSize: Theme.small; wrapMode: Text.Wrap
                Accessible.role: Accessible.AlertMessage
                Accessible.name: text
            }
            Repeater {
                model: form.view.warnings
                Text {
                    required property string modelData
                    Layout.fillWidth: true
                    text: modelData
                    color: Theme.warning; font.pixelSize: Theme.small; wrapMode: Text.Wrap
                }
            }
            Text {
                objectName: "checked"
                visible: form.view.check.done
                Layout.fillWidth: true
                text: form.view.check.feasible
                    ? qsTr("Rehearsed: %n motion(s) verified", "", form.view.check.motions)
                      + (form.view.check.unknown ? qsTr(", %n step(s) can only be found out by doing them", "", form.view.check.unknown) : "")
                    : qsTr("Not feasible at %1: %2").arg(Words.name(form.view.check.where)).arg(form.view.check.why)
                color: form.view.check.feasible ? Theme.good : Theme.danger
                font.pixelSize: Theme.small; wrapMode: Text.Wrap
                Accessible.role: Accessible.StaticText
                Accessible.name: text
            }
        }
    }

    RowLayout {
        Layout.fillWidth: true
        spacing: Theme.tight
        ActionButton {
            objectName: "rehearse"
            Layout.fillWidth: true
            Layout.preferredWidth: 1
            text: qsTr("Rehearse")
            why: Words.why(form.view.why.check)
            Accessible.name: qsTr("Rehearse the program without moving")
            onClicked: desk.library.do("check")
        }
        ActionButton {
            objectName: "setInRun"
            visible: form.view.running
            Layout.fillWidth: true
            Layout.preferredWidth: 1
            tone: "primary"
            text: qsTr("Set in the run")
            why: Words.why(form.view.why.set)
            Accessible.name: qsTr("Give the run what was set here: it counts from its next use")
            onClicked: desk.library.apply()
        }
        ActionButton {
            objectName: "launch"
            visible: !form.view.running
            Layout.fillWidth: true
            Layout.preferredWidth: 1
            tone: "primary"
            text: qsTr("Run")
            why: Words.why(form.view.why.run)
            Accessible.name: qsTr("Deploy and run the program")
            onClicked: desk.library.do("run")
        }
    }
}
