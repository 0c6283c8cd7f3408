import QtQuick
import Handrail

// What can be done with the selected template, beside the view.
Flow {
    id: bar

    readonly property var view: desk.bench.view

    signal more()

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
    ActionButton { objectName: "more"; text: qsTr("More …"); Accessible.name: qsTr("All that can be done with %1").arg(bar.view.selected); onClicked: bar.more() }
    ActionButton { objectName: "deselect"; text: qsTr("Done"); onClicked: desk.bench.select("") }
}
