import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What the selected part is, to be changed: what each input gets, what goes out, its parameters. Or: which node to add.
Flickable {
    id: form

    required property var graph
    property bool adding: false
    readonly property var view: graph.view
    readonly property bool can: view.whyEdit === ""
    readonly property bool ofPart: !adding && view.kind === "part"
    readonly property bool ofOwn: !adding && (view.kind === "in" || view.kind === "out")
    signal added()
    signal opened(string node, bool wired)

    clip: true
    contentHeight: column.height
    boundsBehavior: Flickable.StopAtBounds
    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

    component Line: CanvasLine {
        Layout.fillWidth: true
        locked: !form.can
        onEntered: typed => { if (field === "name") form.graph.rename(typed); else form.graph.put(field, typed) }
    }
    component Note: Text {
        Layout.fillWidth: true
        color: Theme.muted
        font.pixelSize: Theme.small
        textFormat: Text.PlainText
        wrapMode: Text.Wrap
    }
    component Entry: AbstractButton {
        id: row
        property string more
        implicitHeight: Theme.touch
        focusPolicy: Qt.StrongFocus
        Accessible.role: Accessible.Button
        Accessible.name: text + (more ? ", " + more : "")
        Accessible.checkable: true
        Accessible.checked: checked
        Keys.onReturnPressed: click()
        Keys.onEnterPressed: click()
        background: Rectangle {
            radius: Theme.tight
            color: row.checked ? Theme.pressed : Theme.raised
            border { width: row.visualFocus ? 2 : 1; color: row.visualFocus || row.checked ? Theme.accent : Theme.line }
        }
        contentItem: Column {
            topPadding: (row.height - 2 * row.padding - children.reduce((sum, each) => sum + (each.visible ? each.height : 0), 0)) / 2
            leftPadding: Theme.tight
            Text { width: row.width - 2 * Theme.tight; text: row.text; textFormat: Text.PlainText; color: Theme.text; font.pixelSize: Theme.small; elide: Text.ElideRight }
            Text { width: row.width - 2 * Theme.tight; visible: text !== ""; text: row.more; textFormat: Text.PlainText; color: Theme.muted; font.pixelSize: Theme.small; elide: Text.ElideRight }
        }
    }

    ColumnLayout {
        id: column
        width: form.width - Theme.tight
        spacing: Theme.tight

        // ------------------------------------------------------------------------------------------------ add a node
        Caption { visible: form.adding; Layout.fillWidth: true; text: qsTr("Add a node of the library") }
        Note {
            visible: form.adding && nodes.count === 0
            text: qsTr("The engine's library has no other node. Write one under Code, or save one from an example: handrail new node NAME.")
        }
        Repeater {
            id: nodes
            model: form.graph.nodes
            Entry {
                required property string name
                required property string title
                visible: form.adding
                Layout.fillWidth: true
                objectName: "add_" + name
                text: name
                more: title
                onClicked: { form.graph.add(name); form.added() }
            }
        }

        // --------------------------------------------------------------------------------------------- nothing selected
        Note {
            visible: !form.adding && form.view.kind === ""
            text: qsTr("Touch a part, a port or a wire. Drag from a port's dot to another port, or to another part, to connect them. Two fingers, or Ctrl and the wheel, zoom.")
            font.pixelSize: Theme.body
        }
        Line { visible: !form.adding && form.view.kind === ""; field: "title"; label: qsTr("What it does"); value: form.view.title }
        Line { visible: !form.adding && form.view.kind === ""; field: "every"; label: qsTr("Steps every, in s"); value: form.view.every; hint: qsTr("when it is asked") }
        RunningNodes { visible: !form.adding && form.view.kind === ""; Layout.fillWidth: true }

        // ----------------------------------------------------------------------------------------------------- a part
        Caption { visible: form.ofPart; Layout.fillWidth: true; text: qsTr("Part") }
        Line { visible: form.ofPart; field: "name"; label: qsTr("Name"); value: form.view.name }
        RowLayout {
            visible: form.ofPart
            Layout.fillWidth: true
            spacing: Theme.tight
            ColumnLayout {
                Layout.fillWidth: true
                spacing: 0
                Text { Layout.fillWidth: true; text: form.view.node; textFormat: Text.PlainText; color: Theme.text; font.pixelSize: Theme.body; elide: Text.ElideRight }
                Note { visible: text !== ""; text: form.view.about; maximumLineCount: 3; elide: Text.ElideRight }
            }
            ActionButton {
                objectName: "graphOpen"
                text: qsTr("Open")
                enabled: form.view.known
                Accessible.name: form.view.wired ? qsTr("Show what %1 is made of").arg(form.view.node) : qsTr("Show the code of %1").arg(form.view.node)
                onClicked: form.opened(form.view.node, form.view.wired)
            }
        }
        Note { objectName: "graphNodeProblem"; visible: form.ofPart && text !== ""; text: form.view.nodeProblem; color: Theme.danger }

        Caption { visible: form.ofPart && ins.count > 0; Layout.fillWidth: true; text: qsTr("Gets") }
        Repeater {
            id: ins
            model: form.graph.inputs
            ColumnLayout {
                id: input
                required property string name
                required property string about
                required property string source
                required property bool selected
                required property var sources
                visible: form.ofPart
                Layout.fillWidth: true
                spacing: Theme.tight
                Entry {
                    Layout.fillWidth: true
                    objectName: "input_" + input.name
                    text: input.source ? input.name + "  ←  " + input.source.replace(":in.", qsTr("input") + " ") : input.name + "  ←  " + qsTr("nothing yet")
                    more: input.about
                    checked: input.selected
                    onClicked: form.graph.selectPort(input.name, false)
                }
                Flow {
                    visible: input.selected && form.can
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    Repeater {
                        model: input.sources
                        ActionButton {
                            required property var modelData
                            objectName: "source_" + (modelData.kind === "part" || modelData.kind === "in" ? modelData.text : modelData.kind)
                            text: modelData.kind === "nothing" ? qsTr("nothing") : modelData.kind === "new" ? qsTr("new input") : modelData.kind === "in" ? qsTr("input %1").arg(modelData.text) : modelData.text
                            checked: modelData.chosen
                            Accessible.name: qsTr("%1 gets: %2").arg(input.name).arg(text)
                            Accessible.checkable: true
                            Accessible.checked: checked
                            onClicked: form.graph.feed(input.name, modelData.id)
                        }
                    }
                }
            }
        }
        Caption {
            visible: (form.ofPart || form.ofOwn) && outs.count > 0
            Layout.fillWidth: true
            text: form.view.kind === "in" ? qsTr("Comes from outside") : form.view.kind === "out" ? qsTr("Goes out") : qsTr("Tells")
        }
        Repeater {
            id: outs
            model: form.graph.outputs
            RowLayout {
                id: output
                required property string name
                required property string about
                required property string own
                required property string goes
                required property bool selected
                visible: form.ofPart || form.ofOwn
                Layout.fillWidth: true
                spacing: Theme.tight
                Entry {
                    Layout.fillWidth: true
                    objectName: "output_" + output.name
                    text: output.goes ? output.name + (form.view.kind === "in" ? "  →  " : "  ←  ") + output.goes : output.name
                    more: output.about
                    checked: output.selected
                    onClicked: form.graph.selectPort(output.name, form.view.kind !== "out")
                }
                ActionButton {
                    visible: form.ofPart
                    objectName: "tell_" + output.name
                    text: output.own ? qsTr("as %1").arg(output.own) : qsTr("Out")
                    checked: output.own !== ""
                    enabled: form.can
                    Accessible.name: qsTr("%1 goes out of all of it").arg(output.name)
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: form.graph.tell(output.name, output.own === "")
                }
            }
        }
        Line { visible: form.ofOwn && form.view.port !== ""; field: "name"; label: qsTr("Name"); value: form.view.name }

        Caption { visible: form.ofPart && settings.count > 0; Layout.fillWidth: true; text: qsTr("Parameters") }
        Repeater {
            id: settings
            model: form.graph.settings
            ColumnLayout {
                id: setting
                required property string name
                required property string title
                required property string type
                required property string unit
                required property var value
                required property real low
                required property real high
                required property bool bounded
                required property real step
                required property bool fits
                required property string expected
                required property var choices
                required property string doc
                required property string own
                visible: form.ofPart
                Layout.fillWidth: true
                spacing: Theme.tight
                LaunchParameter {
                    Layout.fillWidth: true
                    enabled: form.can
                    kind: "setting"
                    name: setting.name
                    title: setting.title
                    type: setting.type
                    unit: setting.unit
                    value: setting.value
                    low: setting.low
                    high: setting.high
                    bounded: setting.bounded
                    step: setting.step
                    fits: setting.fits
                    expected: setting.expected
                    choices: setting.choices
                    onTurned: number => form.graph.turn(name, number)
                    onSwitched: on => form.graph.switch(name, on)
                    onWritten: text => form.graph.write(name, text)
                }
                RowLayout {
                    Layout.fillWidth: true
                    spacing: Theme.tight
                    Note { text: setting.doc }
                    ActionButton {
                        objectName: "outside_" + setting.name
                        text: setting.own ? qsTr("set as %1").arg(setting.own) : qsTr("Set outside")
                        checked: setting.own !== ""
                        enabled: form.can
                        Accessible.name: qsTr("%1 can be set from outside").arg(setting.name)
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: form.graph.outside(setting.name, setting.own === "")
                    }
                }
            }
        }
    }
}
