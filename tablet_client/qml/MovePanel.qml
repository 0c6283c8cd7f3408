import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The robot moved by hand: steps, motions that last while a button is held, a target for the tool, the joints one by one.
Panel {
    id: panel

    readonly property var view: desk.move.view
    readonly property bool hold: view.mode === "hold"
    readonly property string why: Words.why(view.why.jog)

    Flickable {
        id: flick
        objectName: "move"
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        clip: true
        contentHeight: column.implicitHeight
        boundsBehavior: Flickable.StopAtBounds
        pressDelay: 0
        interactive: view.held === ""
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

        component Line: Text {
            Layout.fillWidth: true
            color: Theme.muted; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            Accessible.role: Accessible.StaticText
            Accessible.name: text
        }

        ColumnLayout {
            id: column
            width: flick.width - Theme.tight
            spacing: Theme.gap

            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.gap
                Choice {
                    visible: options.length > 1
                    Layout.fillWidth: true
                    prefix: "moveArm"
                    options: panel.view.arms.map(name => ({ name: name, text: Words.name(name), more: qsTr("Move the arm: %1").arg(Words.name(name)) }))
                    chosen: panel.view.arm
                    onTaken: name => desk.move.chooseArm(name)
                }
                Choice {
                    Layout.fillWidth: true
                    prefix: "moveAxes"
                    options: [{ name: "world", text: qsTr("World"), more: qsTr("Along the world's axes") },
                              { name: "tool", text: qsTr("Tool"), more: qsTr("Along the tool's axes") }]
                    chosen: panel.view.axes
                    onTaken: name => desk.move.chooseAxes(name)
                }
            }
            Choice {
                Layout.fillWidth: true
                prefix: "moveMode"
                options: [{ name: "fine", text: qsTr("1 mm, 1°"), more: qsTr("A tap moves 1 mm or turns 1 degree") },
                          { name: "coarse", text: qsTr("1 cm, 5°"), more: qsTr("A tap moves 1 cm or turns 5 degrees") },
                          { name: "hold", text: qsTr("While held"), more: qsTr("Moves while a button is held") }]
                chosen: panel.view.mode
                onTaken: name => desk.move.chooseMode(name)
            }
            Line {
                objectName: "moveSaid"
                readonly property string problem: panel.view.told || Words.why(panel.view.problem)
                text: panel.why !== "" ? qsTr("Can't move now: %1.").arg(panel.why)
                    : problem !== "" ? qsTr("Did not go on: %1.").arg(problem)
                    : panel.hold ? qsTr("Moves while a button is held, 4 cm/s or 14°/s. Without this window it stops by itself.")
                    : qsTr("Moves at once, without a plan. What stands in the way is not looked for.")
                color: panel.why !== "" || problem !== "" ? Theme.warning : Theme.muted
            }

            // ------------------------------------------------------------------------------------------------- the tool
            Caption { text: qsTr("Tool") }
            GridLayout {
                Layout.fillWidth: true
                columns: 6
                columnSpacing: Theme.tight
                rowSpacing: Theme.tight
                Repeater {
                    model: 12
                    MoveButton {
                        required property int index
                        readonly property bool turns: index >= 6
                        Layout.fillWidth: true
                        Layout.preferredWidth: 1
                        what: ["tx", "ty", "tz", "rx", "ry", "rz"][Math.floor(index / 2)]
                        sign: index % 2 ? 1 : -1
                        enabled: panel.why === ""
                        text: (sign > 0 ? "+" : "−") + (turns ? "↻" : "") + what[1]
                        Accessible.name: (turns ? sign > 0 ? qsTr("Turn the tool about %1") : qsTr("Turn the tool back about %1")
                                                : sign > 0 ? qsTr("Move the tool along %1") : qsTr("Move the tool back along %1")).arg(what[1])
                    }
                }
            }

            // ----------------------------------------------------------------------------------------------- the target
            Caption { text: qsTr("Target") }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: [{ aim: "tool", name: "moveTarget", text: qsTr("Of the tool"), more: qsTr("Drag where the tool is to go") },
                            { aim: "mass", name: "moveMass", text: qsTr("Centre of mass"), more: qsTr("Drag where the centre of mass is to go") }]
                    ActionButton {
                        required property var modelData
                        objectName: modelData.name
                        Layout.fillWidth: true
                        Layout.preferredWidth: 1
                        text: modelData.text
                        why: checked ? "" : Words.why(panel.view.why.target)
                        checked: panel.view.target === modelData.aim
                        Accessible.name: modelData.more
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: desk.move.showTarget(checked ? "" : modelData.aim)
                    }
                }
            }
            RowLayout {
                visible: panel.view.target !== ""
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: ["x", "y", "z"]
                    NumberField {
                        required property int index
                        required property string modelData
                        Layout.fillWidth: true
                        Layout.preferredWidth: 1
                        enabled: !panel.view.fixed.includes(modelData)
                        opacity: enabled ? 1 : 0.5
                        label: modelData
                        name: qsTr("target %1").arg(modelData)
                        unit: "mm"
                        value: panel.view.place[index] ?? 0
                        onEntered: number => desk.move.place(index, number)
                    }
                }
            }
            RowLayout {
                visible: panel.view.target !== ""
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton {
                    Layout.fillWidth: true
                    objectName: "moveSnap"
                    text: qsTr("Snap")
                    checked: panel.view.snap
                    Accessible.name: qsTr("Snap to 1 cm and 5°")
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.move.choose("snap", !panel.view.snap)
                }
                ActionButton {
                    Layout.fillWidth: true
                    objectName: "moveFine"
                    text: qsTr("Fine")
                    checked: panel.view.fine
                    Accessible.name: qsTr("Fine: a tenth of the finger's way")
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.move.choose("fine", !panel.view.fine)
                }
            }
            Choice {
                visible: panel.view.target === "tool"
                Layout.fillWidth: true
                prefix: "moveTurn"
                options: [{ name: "all", text: qsTr("As turned"), more: qsTr("The tool is turned as the target is") },
                          { name: "z", text: qsTr("Axis only"), more: qsTr("Only the tool's z axis points as the target's") },
                          { name: "none", text: qsTr("Place only"), more: qsTr("However the tool is turned") }]
                chosen: panel.view.turn
                onTaken: name => desk.move.chooseTurn(name)
            }
            Choice {
                visible: panel.view.target === "mass" && !panel.view.on_feet
                Layout.fillWidth: true
                prefix: "moveMassTurn"
                options: [{ name: "all", text: qsTr("In height, too"), more: qsTr("The centre of mass is as high as the target") },
                          { name: "none", text: qsTr("Seen from above"), more: qsTr("However high the centre of mass is") }]
                chosen: panel.view.turn === "none" ? "none" : "all"
                onTaken: name => desk.move.chooseTurn(name)
            }
            Flow {
                objectName: "moveKept"
                visible: panel.view.offered.length > 0
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: panel.view.offered
                    ActionButton {
                        required property string modelData
                        objectName: "moveKeep_" + modelData
                        text: Words.kept(modelData, panel.view.target)
                        checked: panel.view.kept.includes(modelData)
                        Accessible.name: Words.keptMore(modelData)
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: desk.move.keep(modelData, !checked)
                    }
                }
            }
            Line {
                visible: panel.view.target !== "" && panel.view.on_feet
                text: panel.view.target === "mass" ? qsTr("Feet stay, and balance is kept: the centre of mass goes up and down over them.")
                                                   : qsTr("Feet stay, and balance is kept.")
            }
            Line {
                objectName: "moveMisses"
                visible: panel.view.target !== ""
                text: panel.view.reached ? qsTr("The robot gets there.")
                    : panel.view.lost !== "" ? qsTr("Not there and with: %1.").arg(Words.kept(panel.view.lost, panel.view.target))
                    : panel.view.target === "mass" ? qsTr("Out of reach: the nearest is %1 off.").arg(panel.view.off)
                    : qsTr("Out of reach: the nearest is %1 and %2 off.").arg(panel.view.off).arg(panel.view.turned)
                color: panel.view.reached ? Theme.good : Theme.danger
            }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton {
                    objectName: "moveSeen"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: qsTr("Around what is seen")
                    checked: panel.view.seen
                    Accessible.name: qsTr("Keep clear of what cameras see, too")
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.move.choose("seen", !panel.view.seen)
                }
                ActionButton {
                    objectName: "moveRelax"
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: qsTr("As near as it gets")
                    checked: panel.view.relax
                    Accessible.name: qsTr("Where it can't be reached, plan to as near as possible")
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: desk.move.choose("relax", !panel.view.relax)
                }
            }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton {
                    objectName: "movePlan"
                    Layout.fillWidth: true
                    tone: "primary"
                    text: qsTr("Plan")
                    why: Words.why(panel.view.why.plan)
                    Accessible.name: qsTr("Plan a motion to what the ghost shows")
                    onClicked: desk.move.plan()
                }
                ActionButton {
                    visible: panel.view.shown
                    objectName: "moveReset"
                    text: qsTr("Drop")
                    Accessible.name: qsTr("Show the robot as it is")
                    onClicked: desk.move.reset()
                }
            }

            // ----------------------------------------------------------------------------------------------- the joints
            Caption { text: qsTr("Joints") }
            Repeater {
                model: desk.move.joints
                RowLayout {
                    id: joint
                    required property string name
                    required property string title
                    required property string unit
                    required property real value
                    required property real low
                    required property real high
                    required property real step
                    required property string text
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    MoveButton {
                        what: joint.name
                        sign: -1
                        enabled: panel.why === ""
                        text: "−"
                        Accessible.name: qsTr("%1 back").arg(joint.title)
                    }
                    ValueSlider {
                        Layout.fillWidth: true
                        kind: "moveJoint"
                        name: joint.name
                        title: joint.title
                        unit: joint.unit
                        value: joint.value
                        low: joint.low
                        high: joint.high
                        step: joint.step
                        text: joint.text
                        why: panel.view.why.target
                        onMoved: number => desk.move.slide(joint.name, number)
                    }
                    MoveButton {
                        what: joint.name
                        sign: 1
                        enabled: panel.why === ""
                        text: "+"
                        Accessible.name: qsTr("%1 on").arg(joint.title)
                    }
                }
            }
        }
    }
}
