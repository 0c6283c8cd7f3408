import QtQuick
import Handrail

// What can be done with the selected template, beside the view.
Flow {
    id: bar

    readonly property var view: desk.bench.view

    objectName: "contextBar"
    visible: view.selected !== ""
    spacing: Theme.tight

    ActionButton {
        objectName: "snap"
        text: qsTr("Snap")
        checked: bar.view.snap
        Accessible.name: qsTr("Snap to 1 cm and 5°")
        Accessible.checkable: true
        Accessible.checked: checked
        onClicked: desk.bench.setSnap(!bar.view.snap)
    }
    ActionButton {
        objectName: "fine"
        text: qsTr("Fine")
        checked: bar.view.fine
        Accessible.name: qsTr("Fine: a tenth of the finger's way")
        Accessible.checkable: true
        Accessible.checked: checked
        onClicked: desk.bench.setFine(!bar.view.fine)
    }
    ActionButton { objectName: "undo"; text: qsTr("Undo"); why: Words.why(bar.view.why.undo); onClicked: desk.bench.do("undo") }
    ActionButton { objectName: "redo"; text: qsTr("Redo"); why: Words.why(bar.view.why.redo); onClicked: desk.bench.do("redo") }
    ActionButton { objectName: "copy"; text: qsTr("Copy"); why: Words.why(bar.view.why.copy); onClicked: desk.bench.do("copy") }
    // Asked twice, on the same button: undo brings it back.
    ActionButton {
        id: remove
        property bool sure: false
        objectName: "delete"
        tone: "danger"
        text: sure ? qsTr("Really delete") : qsTr("Delete")
        why: Words.why(bar.view.why.delete)
        onClicked: { if (sure) desk.bench.do("delete"); sure = !sure }
        Timer { running: remove.sure; interval: 3000; onTriggered: remove.sure = false }
    }
    ActionButton { objectName: "deselect"; text: qsTr("Done"); onClicked: desk.bench.select("") }
}
