import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What is placed in the world, and all that can be changed of the one that is selected.
Panel {
    id: panel

    readonly property var view: desk.bench.view
    readonly property bool one: view.selected !== ""

    // A section that was asked for from elsewhere comes into sight, once the layout has room for it.
    readonly property string section: Pages.current === "objects" ? Pages.section : ""
    onSectionChanged: if (section) Qt.callLater(reveal)
    Component.onCompleted: if (section) Qt.callLater(reveal)
    function reveal() {
        const head = ({ waypoints: waypointsHead, parameters: parametersHead, joints: jointsHead })[section]
        if (head) flick.contentY = Math.max(0, Math.min(head.y, flick.contentHeight - flick.height))
        Pages.section = ""
    }

    Flickable {
        id: flick
        objectName: "objects"
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        clip: true
        contentHeight: column.implicitHeight
        boundsBehavior: Flickable.StopAtBounds
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

        ColumnLayout {
            id: column
            width: flick.width - Theme.tight
            spacing: Theme.gap

            Caption { text: qsTr("Placed") }
            Text {
                visible: desk.header.places.length === 0
                Layout.fillWidth: true
                text: qsTr("Nothing is placed yet. Choose a template below, then drag it by its handle to where the camera sees the real thing.")
                color: Theme.muted; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            }
            Flow {
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: desk.bench.instances
                    ActionButton {
                        required property string name
                        required property string template
                        required property bool selected
                        required property string heldBy
                        objectName: "instance_" + name
                        text: heldBy ? qsTr("%1 · held by %2").arg(name).arg(heldBy) : name
                        checked: selected
                        Accessible.name: qsTr("%1, a %2").arg(name).arg(Words.name(template))
                        Accessible.checkable: true
                        Accessible.checked: selected
                        onClicked: desk.bench.select(selected ? "" : name)
                    }
                }
            }

            // ------------------------------------------------------------------------------------------ the selected one
            GridLayout {
                visible: panel.one
                Layout.fillWidth: true
                columns: 3
                columnSpacing: Theme.tight
                rowSpacing: Theme.tight
                Repeater {
                    model: [{ name: qsTr("x"), unit: "mm" }, { name: qsTr("y"), unit: "mm" }, { name: qsTr("z"), unit: "mm" },
                            { name: qsTr("roll"), unit: "°" }, { name: qsTr("pitch"), unit: "°" }, { name: qsTr("yaw"), unit: "°" }]
                    NumberField {
                        required property int index
                        required property var modelData
                        Layout.fillWidth: true
                        Layout.preferredWidth: 1
                        label: modelData.name
                        unit: modelData.unit
                        value: panel.view.numbers[index] ?? 0
                        onEntered: number => desk.bench.put(index, number)
                    }
                }
            }
            Caption { id: waypointsHead; visible: panel.one && panel.view.trajectories.length > 0; text: qsTr("Waypoints") }
            Flow {
                visible: panel.one && panel.view.trajectories.length > 0
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: panel.view.trajectories
                    ActionButton {
                        required property string modelData
                        objectName: "trajectory_" + modelData
                        text: Words.name(modelData)
                        checked: panel.view.trajectory === modelData
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: desk.bench.chooseTrajectory(modelData)
                    }
                }
                Item { width: Theme.gap; height: 1 }
                Repeater {
                    model: panel.view.arms
                    ActionButton {
                        required property string modelData
                        objectName: "arm_" + modelData
                        text: Words.name(modelData)
                        checked: panel.view.arm === modelData
                        Accessible.name: qsTr("With the %1 arm").arg(text)
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: desk.bench.chooseArm(modelData)
                    }
                }
            }
            Column {
                visible: panel.one
                Layout.fillWidth: true
                spacing: Math.round(3 * Theme.scale)
                Repeater {
                    model: desk.bench.waypoints
                    Row {
                        id: way
                        required property string name
                        required property string state
                        required property string constraint
                        required property string about
                        required property string size
                        readonly property string why: Words.reachedHow(state, constraint, about, size)
                        objectName: "reach_" + name
                        width: parent.width
                        spacing: Theme.tight
                        Accessible.role: Accessible.StaticText
                        Accessible.name: qsTr("%1: %2").arg(Words.name(name)).arg(why)
                        Rectangle {
                            y: Math.round(4 * Theme.scale)
                            width: Math.round(9 * Theme.scale); height: width
                            radius: way.state === "not" ? 1 : width / 2
                            color: Words.reachColor(way.state)
                        }
                        Text {
                            width: Math.round(84 * Theme.scale)
                            text: Words.name(way.name)
                            color: Theme.text; font.pixelSize: Theme.small; elide: Text.ElideRight
                        }
                        Text {
                            width: way.width - Math.round(108 * Theme.scale)
                            text: way.why
                            color: way.state === "not" ? Theme.danger : way.state === "near" ? Theme.warning : Theme.muted
                            font.pixelSize: Theme.small; wrapMode: Text.Wrap
                        }
                    }
                }
                Text {
                    objectName: "reachProblem"
                    width: parent.width
                    visible: text !== ""
                    text: panel.view.reachProblem ? qsTr("What can be reached is not known: %1").arg(panel.view.reachProblem) : ""
                    color: Theme.warning; font.pixelSize: Theme.small; wrapMode: Text.Wrap
                }
            }
            ActionButton {
                objectName: "plan"
                visible: panel.one && panel.view.trajectories.length > 0
                Layout.fillWidth: true
                tone: "primary"
                text: qsTr("Plan “%1”").arg(Words.name(panel.view.trajectory))
                why: Words.why(panel.view.why.plan)
                onClicked: desk.bench.do("plan")
            }
            Caption { id: parametersHead; visible: panel.one; text: qsTr("Parameters") }
            Column {
                visible: panel.one
                Layout.fillWidth: true
                spacing: Theme.tight / 2
                Repeater {
                    model: desk.bench.parameters
                    ValueSlider {
                        width: parent.width
                        why: panel.view.why.edit
                        onMoved: number => desk.bench.turn(name, number)
                        onFinished: desk.bench.letGo(name)
                    }
                }
            }
            RowLayout {
                id: jointsHead
                visible: panel.one && joints.count > 0
                Layout.fillWidth: true
                Caption { text: qsTr("Joints (to look at)"); Layout.fillWidth: true }
                ActionButton {
                    objectName: "believe"
                    visible: panel.view.looked
                    text: qsTr("It is so")
                    why: Words.why(panel.view.why.edit)
                    Accessible.name: qsTr("Tell the robot that the joints are so")
                    onClicked: desk.bench.believe()
                }
                ActionButton {
                    objectName: "lookAway"
                    visible: panel.view.looked
                    text: qsTr("As believed")
                    onClicked: desk.bench.lookAway()
                }
            }
            Column {
                visible: panel.one
                Layout.fillWidth: true
                Repeater {
                    id: joints
                    model: desk.bench.joints
                    ValueSlider {
                        width: parent.width
                        kind: "joint"
                        onMoved: number => desk.bench.lookAt(name, number)
                    }
                }
            }

            // -------------------------------------------------------------------------------------------- another one
            Caption { visible: panel.view.templates.length > 0; text: qsTr("Place a template") }
            Flow {
                Layout.fillWidth: true
                spacing: Theme.tight
                Repeater {
                    model: panel.view.templates
                    ActionButton {
                        required property string modelData
                        objectName: "place_" + modelData
                        text: Words.name(modelData)
                        why: Words.why(panel.view.why.place)
                        Accessible.name: qsTr("Place a %1").arg(text)
                        onClicked: desk.bench.add(modelData)
                    }
                }
            }
            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton { objectName: "undoEdit"; Layout.fillWidth: true; Layout.preferredWidth: 1; text: qsTr("Undo"); why: Words.why(panel.view.why.undo); onClicked: desk.bench.do("undo") }
                ActionButton { objectName: "redoEdit"; Layout.fillWidth: true; Layout.preferredWidth: 1; text: qsTr("Redo"); why: Words.why(panel.view.why.redo); onClicked: desk.bench.do("redo") }
            }
        }
    }
}
