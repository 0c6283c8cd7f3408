import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// Which engine runs what, which code it was given and by whom, and the way back to what it had before.
Flickable {
    id: flick

    readonly property var view: desk.library.view

    objectName: "enginesList"
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

        Caption { text: qsTr("Engines") }
        Repeater {
            model: desk.library.engines
            ActionButton {
                id: engine
                required property string name
                required property bool up
                required property string program
                required property string status
                required property string host
                required property bool chosen
                objectName: "engine_" + name
                Layout.fillWidth: true
                implicitHeight: Math.round(56 * Theme.scale)
                text: host ? qsTr("%1 on %2").arg(name).arg(host) : name
                checked: chosen
                // beside the name, not instead of a press: an engine that is gone is looked at, too
                Accessible.description: doing
                readonly property string doing: !up ? qsTr("does not answer")
                    : program && status ? qsTr("%1: %2").arg(Words.name(program)).arg(Words.run(status)) : qsTr("nothing has run")
                onClicked: desk.library.at(name)
                contentItem: Item {
                    Column {
                        anchors.centerIn: parent
                        Text { anchors.horizontalCenter: parent.horizontalCenter; text: engine.text; color: Theme.text; font.pixelSize: Theme.body; font.weight: Font.Medium }
                        Text { anchors.horizontalCenter: parent.horizontalCenter; text: engine.doing; color: engine.up ? Theme.muted : Theme.danger; font.pixelSize: Theme.small }
                    }
                }
            }
        }
        Line {
            objectName: "runsMatch"
            visible: flick.view.runs.program !== ""
            text: flick.view.runs.match === "same" ? qsTr("What ran last, %1 %2, is what the library has now.").arg(flick.view.runs.program).arg(flick.view.runs.hash)
                : flick.view.runs.match === "differs" ? qsTr("What ran last, %1 %2, is not what the library has now: run it anew to have that.").arg(flick.view.runs.program).arg(flick.view.runs.hash)
                : qsTr("What ran last, %1 %2, is not in the library.").arg(flick.view.runs.program).arg(flick.view.runs.hash)
            color: flick.view.runs.match === "same" ? Theme.good : Theme.warning
        }

        Caption { text: qsTr("Deployed to %1").arg(flick.view.engine); visible: flick.view.engine !== "" }
        Line {
            visible: held.count === 0
            color: Theme.muted
            text: qsTr("Nothing: it runs the programs that it was installed with. Save one under Canvas or Code, or bring it others with: handrail deploy PROGRAM")
        }
        Repeater {
            id: held
            model: desk.library.held
            ColumnLayout {
                id: one
                required property string program
                required property string bundle
                required property int number
                required property string by
                required property string since
                required property string match
                Layout.fillWidth: true
                spacing: Theme.tight
                Line {
                    objectName: "held_" + one.program
                    color: one.match === "differs" ? Theme.warning : Theme.text
                    text: one.words
                }
                Flow {
                    visible: flick.view.others.length > 0
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    Repeater {
                        model: flick.view.others
                        ActionButton {
                            required property string modelData
                            objectName: "bring_" + one.program + "_" + modelData
                            text: qsTr("Deploy to %1").arg(modelData)
                            enabled: flick.view.why.bring === ""
                            Accessible.name: qsTr("Deploy %1 to %2, as it is here").arg(Words.name(one.program)).arg(modelData)
                            onClicked: desk.library.bring(one.program, modelData)
                        }
                    }
                }
                readonly property string words: (number ? qsTr("%1 %2: release %3, by %4, %5").arg(Words.name(program)).arg(bundle).arg(number).arg(by).arg(since)
                              : qsTr("%1 %2: older than what is kept").arg(Words.name(program)).arg(bundle))
                      + (Words.match(match) ? ", " + Words.match(match) : "")
            }
        }
        Line {
            objectName: "brought"
            visible: flick.view.brought.code !== ""
            readonly property var brought: flick.view.brought
            text: brought.code === "brought" ? qsTr("%1 is at %2 now, as a release of its own.").arg(Words.name(brought.what)).arg(brought.engine)
                : brought.code === "bringing" ? qsTr("%1 is being brought to %2 …").arg(Words.name(brought.what)).arg(brought.engine)
                : brought.why ? qsTr("%1 was not brought to %2: %3").arg(Words.name(brought.what)).arg(brought.engine).arg(brought.why)
                : qsTr("%1 was not brought to %2: the link was lost").arg(Words.name(brought.what)).arg(brought.engine)
            color: brought.code === "not_brought" ? Theme.danger : Theme.muted
        }

        Caption { visible: releases.count > 0; text: qsTr("Releases") }
        Repeater {
            id: releases
            model: desk.library.releases
            RowLayout {
                id: release
                required property int number
                required property string program
                required property string by
                required property string since
                required property string note
                required property var changed
                required property bool inForce
                Layout.fillWidth: true
                spacing: Theme.tight
                Line {
                    text: qsTr("%1: %2, by %3, %4").arg(release.number).arg(Words.name(release.program)).arg(release.by).arg(release.since)
                          + (release.note ? "\n" + release.note : "")
                          + (release.changed.length ? "\n" + qsTr("%n file(s) changed", "", release.changed.length) : "")
                }
                // Asked twice, on the same button: it can itself be rolled back.
                ActionButton {
                    id: back
                    property bool sure: false
                    objectName: "rollBack_" + release.number
                    Layout.preferredWidth: Math.round(116 * Theme.scale)
                    tone: sure ? "danger" : "plain"
                    text: release.inForce ? qsTr("in force") : sure ? qsTr("Really") : qsTr("Roll back")
                    enabled: !release.inForce && why === ""
                    why: release.inForce ? "" : Words.why(flick.view.why.roll_back)
                    Accessible.name: release.inForce ? qsTr("Release %1 is in force").arg(release.number) : qsTr("Roll back to release %1").arg(release.number)
                    onClicked: { if (sure) desk.library.rollBack(release.number); sure = !sure }
                    Timer { running: back.sure; interval: 3000; onTriggered: back.sure = false }
                }
            }
        }
        Line {
            objectName: "engineProblem"
            visible: text !== ""
            text: flick.view.engineProblem
            color: Theme.danger
        }
    }
}
