import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What the selected state or way is, to be changed: each field as it stands in the program's file.
Flickable {
    id: form

    required property var canvas
    readonly property var view: canvas.view
    readonly property var state: view.state
    readonly property bool there: state.name !== undefined
    readonly property bool ofWay: there && view.way >= 0

    clip: true
    contentHeight: column.height
    boundsBehavior: Flickable.StopAtBounds
    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(6 * Theme.scale) }

    component Line: CanvasLine {
        width: column.width
        onEntered: typed => { if (field === "name") form.canvas.rename(typed); else form.canvas.put(field, typed) }
    }

    component Mark: ActionButton {
        property string field
        Layout.fillWidth: true
        Layout.preferredWidth: 1
        Accessible.checkable: true
        Accessible.checked: checked
        onClicked: form.canvas.mark(field, !checked)
    }

    Column {
        id: column
        width: form.width - Theme.tight
        spacing: Theme.tight

        Text {
            visible: !form.there
            width: parent.width
            text: qsTr("Touch a state, or the words on a line. Drag from a selected state's dot to another state to connect them. Two fingers, or Ctrl and the wheel, zoom.")
            color: Theme.muted
            font.pixelSize: Theme.body
            wrapMode: Text.Wrap
        }
        Caption { visible: form.there; text: form.ofWay ? qsTr("Way out of %1").arg(form.state.name) : qsTr("State") }

        Line { visible: form.there && !form.ofWay; field: "name"; label: qsTr("Name"); value: form.state.name || "" }
        Line { visible: form.there && !form.ofWay; field: "title"; label: qsTr("Title"); value: form.state.title || "" }
        Line { visible: form.there && !form.ofWay && !form.state.final; field: "do"; label: qsTr("Does"); value: form.state.do || ""; hint: qsTr("nothing: it only decides") }
        Column {
            visible: form.there && !form.ofWay && (form.state.do || "") !== ""
            width: column.width
            spacing: Math.round(2 * Theme.scale)
            Text { text: qsTr("With"); color: Theme.muted; font.pixelSize: Theme.small }
            TextArea {
                id: given
                objectName: "canvas_with"
                width: parent.width
                height: Math.max(2 * Theme.touch, implicitHeight)
                color: Theme.text
                font { pixelSize: Theme.small; family: "monospace" }
                wrapMode: TextArea.Wrap
                selectByMouse: true
                Accessible.name: qsTr("What its activity is given: a line each, name: value")
                property bool typed: false
                Keys.onPressed: event => { if (event.key === Qt.Key_Escape) { desk.stop(); event.accepted = true } else typed = true }
                KeyNavigation.priority: KeyNavigation.BeforeItem
                KeyNavigation.tab: outcome
                onActiveFocusChanged: if (!activeFocus && typed) { const lines = text; typed = false; form.canvas.put("with", lines) }
                Binding on text { when: !given.typed; value: form.state.with || ""; restoreMode: Binding.RestoreNone }
                background: Rectangle {
                    radius: Theme.tight
                    color: Theme.ground
                    border { width: given.activeFocus ? 2 : 1; color: given.activeFocus ? Theme.accent : Theme.line }
                }
            }
        }
        RowLayout {
            visible: form.there && !form.ofWay
            width: column.width
            spacing: Theme.tight
            Mark { objectName: "canvas_initial"; field: "initial"; text: qsTr("First"); checked: form.state.initial === true; Accessible.name: qsTr("Entered first") }
            Mark { objectName: "canvas_final"; field: "final"; text: qsTr("End"); checked: form.state.final === true; Accessible.name: qsTr("Ends the program") }
            Mark { objectName: "canvas_parallel"; field: "parallel"; text: qsTr("Parallel"); checked: form.state.parallel === true; Accessible.name: qsTr("What is in it runs side by side") }
        }
        Choice {
            id: outcome
            visible: form.there && !form.ofWay && form.state.final === true
            width: column.width
            prefix: "canvas_outcome"
            chosen: form.state.outcome || ""
            options: [{ name: "succeeded", text: qsTr("Succeeded") }, { name: "failed", text: qsTr("Failed") }]
            onTaken: name => form.canvas.put("outcome", name)
        }
        Line { visible: form.there && !form.ofWay && form.state.final === true; field: "detail"; label: qsTr("What it says then"); value: form.state.detail || "" }

        Line { visible: form.ofWay; field: "event"; label: qsTr("Event"); value: form.state.event || ""; hint: qsTr("none: at once") }
        Line { visible: form.ofWay; field: "after"; label: qsTr("After, in s"); value: form.state.after || ""; hint: qsTr("no time-out") }
        Line { visible: form.ofWay; field: "cond"; label: qsTr("Only if"); value: form.state.cond || ""; hint: qsTr("always") }
        Line { visible: form.ofWay; field: "target"; label: qsTr("Leads to"); value: form.state.target || ""; hint: qsTr("it stays") }
        Line { visible: form.ofWay; field: "set"; label: qsTr("Sets"); value: form.state.set || ""; hint: qsTr("nothing: {variable: expression}") }
        Line { visible: form.ofWay; field: "autonomy"; label: qsTr("Asked up to the level"); value: form.state.autonomy || ""; hint: qsTr("not asked: off, low, high or full") }

        Caption { visible: form.there && (form.state.ways || []).length > 0; text: qsTr("Ways out") }
        Repeater {
            model: form.there ? form.state.ways : []
            AbstractButton {
                id: way
                required property string modelData
                required property int index
                objectName: "canvas_way_" + index
                width: column.width
                height: Theme.touch
                focusPolicy: Qt.StrongFocus
                text: modelData
                Accessible.role: Accessible.Button
                Accessible.name: text
                Accessible.checkable: true
                Accessible.checked: form.view.way === index
                onClicked: form.canvas.selectWay(form.view.way === index ? -1 : index)
                Keys.onReturnPressed: click()
                Keys.onEnterPressed: click()
                background: Rectangle {
                    radius: Theme.tight
                    color: form.view.way === way.index ? Theme.pressed : Theme.raised
                    border { width: way.visualFocus ? 2 : 1; color: way.visualFocus || form.view.way === way.index ? Theme.accent : Theme.line }
                }
                contentItem: Text {
                    leftPadding: Theme.tight
                    text: way.text
                    textFormat: Text.PlainText
                    color: Theme.text
                    font.pixelSize: Theme.small
                    elide: Text.ElideRight
                    verticalAlignment: Text.AlignVCenter
                }
            }
        }
    }
}
