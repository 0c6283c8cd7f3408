import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// A program as a picture: states in states and the ways between them, edited here, saved as the same YAML, comments and all.
Panel {
    id: panel

    readonly property var canvas: desk.workshop.canvas
    readonly property var code: desk.workshop.code
    readonly property var view: canvas.view
    readonly property bool open: code.view.kind === "program" && code.view.loaded
    readonly property bool can: open && view.whyEdit === ""
    readonly property bool some: view.state.name !== undefined
    property real zoom: 1
    property string _fitted
    property bool _zoomed: false // by hand: it is not fitted again

    onVisibleChanged: canvas.watch(visible)
    Component.onCompleted: canvas.watch(visible)

    component Tool: ActionButton { opacity: enabled ? 1 : 0.45 }

    function fit() {
        if (!view.there) return
        zoom = Math.max(0.3, Math.min(1.2, (flick.width - 8) / view.width, (flick.height - 8) / view.height))
        flick.contentX = flick.contentY = 0
    }
    // Another zoom, with the picture's point at (x, y) of the view where it is.
    function zoomTo(wanted, x, y) {
        _zoomed = true
        const next = Math.max(0.3, Math.min(2.5, wanted)), by = next / zoom
        const left = (flick.contentX + x) * by - x, top = (flick.contentY + y) * by - y
        zoom = next
        flick.contentX = Math.max(0, Math.min(left, flick.contentWidth - flick.width))
        flick.contentY = Math.max(0, Math.min(top, flick.contentHeight - flick.height))
    }
    // Once for each program that is opened.
    function settle() {
        if (!visible || !view.there || flick.width < 50) return
        if (_fitted !== code.view.current) { _fitted = code.view.current; _zoomed = false }
        if (_zoomed) return
        fit()
        if (zoom >= 0.6) return
        zoom = 0.6 // what is smaller can't be read: from where it begins, or is
        const start = view.start
        flick.contentX = Math.max(0, Math.min(start.x * zoom - flick.width / 2, flick.contentWidth - flick.width))
        flick.contentY = Math.max(0, Math.min(start.y * zoom - flick.height / 3, flick.contentHeight - flick.height))
    }
    onViewChanged: if (view.there && _fitted !== code.view.current) settle()

    RowLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Theme.gap

        ListView {
            id: list
            objectName: "canvasPrograms"
            Layout.preferredWidth: Math.round(150 * Theme.scale)
            Layout.maximumWidth: Math.round(150 * Theme.scale)
            Layout.fillHeight: true
            clip: true
            model: panel.view.programs
            spacing: Math.round(3 * Theme.scale)
            boundsBehavior: Flickable.StopAtBounds
            activeFocusOnTab: false
            Accessible.role: Accessible.List
            Accessible.name: qsTr("Programs")
            header: Caption { text: qsTr("Programs"); bottomPadding: Theme.tight }
            delegate: ActionButton {
                required property string modelData
                objectName: "canvas_program_" + modelData
                width: list.width
                text: modelData
                checked: panel.code.view.kind === "program" && panel.code.view.title === modelData
                onClicked: panel.code.open("program", modelData)
            }
        }

        ColumnLayout {
            Layout.fillWidth: true
            Layout.fillHeight: true
            spacing: Theme.tight

            RowLayout {
                visible: panel.open
                Layout.fillWidth: true
                spacing: Theme.tight
                Tool { objectName: "canvasAdd"; text: qsTr("Add"); enabled: panel.can; Accessible.name: qsTr("Add a state"); onClicked: panel.canvas.add(false) }
                Tool { objectName: "canvasAddWithin"; text: qsTr("Add inside"); enabled: panel.can && panel.some; Accessible.name: qsTr("Add a state in the selected one"); onClicked: panel.canvas.add(true) }
                Tool {
                    objectName: "canvasConnect"
                    text: panel.view.joining ? qsTr("Touch its end") : qsTr("Connect")
                    enabled: panel.can && panel.some
                    checked: panel.view.joining
                    Accessible.name: qsTr("Connect the selected state with the one that is touched next")
                    onClicked: panel.canvas.joining(!panel.view.joining)
                }
                Tool { objectName: "canvasNest"; text: qsTr("Nest"); enabled: panel.can && panel.some && panel.view.way < 0; Accessible.name: qsTr("Put the selected state into a new one"); onClicked: panel.canvas.nest(panel.view.state.name + "_group") }
                Tool { objectName: "canvasRemove"; text: qsTr("Delete"); enabled: panel.can && panel.some; Accessible.name: panel.view.way < 0 ? qsTr("Delete the selected state") : qsTr("Delete the selected way"); onClicked: panel.canvas.remove() }
                Item { Layout.fillWidth: true }
                Tool { objectName: "canvasUndo"; text: qsTr("Undo"); enabled: panel.view.undo; onClicked: panel.canvas.undo() }
                Tool { objectName: "canvasRedo"; text: qsTr("Redo"); enabled: panel.view.redo; onClicked: panel.canvas.redo() }
            }
            Rectangle {
                Layout.fillWidth: true
                Layout.fillHeight: true
                color: Theme.ground
                radius: Theme.tight
                border { width: ground.activeFocus ? 2 : 1; color: ground.activeFocus ? Theme.accent : Theme.line }
                clip: true

                Flickable {
                    id: flick
                    objectName: "canvasView"
                    anchors { fill: parent; margins: 2 }
                    visible: panel.view.there
                    contentWidth: Math.max(width, panel.view.width * panel.zoom)
                    contentHeight: Math.max(height, panel.view.height * panel.zoom)
                    onWidthChanged: panel.settle()
                    onHeightChanged: panel.settle()
                    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(8 * Theme.scale) }
                    ScrollBar.horizontal: ScrollBar { policy: ScrollBar.AsNeeded; height: Math.round(8 * Theme.scale) }

                    Item {
                        id: ground
                        width: flick.contentWidth
                        height: flick.contentHeight
                        activeFocusOnTab: true
                        Accessible.role: Accessible.Canvas
                        Accessible.name: qsTr("The program's states; the arrow keys go from one to the next")
                        Keys.onRightPressed: panel.canvas.beside(1)
                        Keys.onDownPressed: panel.canvas.beside(1)
                        Keys.onLeftPressed: panel.canvas.beside(-1)
                        Keys.onUpPressed: panel.canvas.beside(-1)
                        Keys.onDeletePressed: if (panel.can) panel.canvas.remove()

                        TapHandler {
                            onTapped: point => {
                                ground.forceActiveFocus()
                                panel.canvas.touchAt(point.position.x / panel.zoom, point.position.y / panel.zoom)
                            }
                        }
                        WheelHandler {
                            acceptedModifiers: Qt.ControlModifier
                            onWheel: event => panel.zoomTo(panel.zoom * Math.pow(1.0015, event.angleDelta.y), event.x - flick.contentX, event.y - flick.contentY)
                        }
                        PinchHandler {
                            target: null
                            property real before: 1
                            onActiveChanged: before = panel.zoom
                            onActiveScaleChanged: if (active) panel.zoomTo(before * activeScale, centroid.position.x - flick.contentX, centroid.position.y - flick.contentY)
                        }
                        Repeater {
                            model: panel.canvas.boxes
                            CanvasBox {
                                zoom: panel.zoom
                                joining: panel.view.joining && !selected
                                onTouched: panel.canvas.touch(name)
                                onJoined: (x, y) => panel.canvas.join(name, x, y)
                            }
                        }
                        CanvasLines {
                            width: panel.view.width * panel.zoom
                            height: panel.view.height * panel.zoom
                            source: panel.canvas
                            zoom: panel.zoom
                            colors: ({ line: Theme.muted, words: Theme.code, chosen: Theme.accent, ground: Theme.ground })
                        }
                    }
                }
                Text {
                    objectName: "canvasEmpty"
                    anchors { fill: parent; margins: Theme.gap }
                    visible: !panel.view.there
                    text: panel.view.problem ? panel.view.problem
                        : panel.open ? ""
                        : panel.code.view.current && panel.code.view.kind === "program" ? qsTr("%1 is being fetched …").arg(panel.code.view.title)
                        : qsTr("Choose a program on the left to see its states and to edit them. What is saved is checked by the engine first, a run goes on in it, and it can be rolled back under Library, Engines' code.")
                    color: panel.view.problem ? Theme.danger : Theme.muted
                    font.pixelSize: Theme.body
                    wrapMode: Text.Wrap
                }
                Row {
                    visible: panel.view.there
                    anchors { right: parent.right; bottom: parent.bottom; margins: Theme.gap }
                    spacing: Theme.tight
                    ActionButton { objectName: "canvasOut"; text: "−"; Accessible.name: qsTr("Smaller"); onClicked: panel.zoomTo(panel.zoom / 1.25, flick.width / 2, flick.height / 2) }
                    ActionButton { objectName: "canvasIn"; text: "+"; Accessible.name: qsTr("Larger"); onClicked: panel.zoomTo(panel.zoom * 1.25, flick.width / 2, flick.height / 2) }
                    ActionButton { objectName: "canvasFit"; text: qsTr("Fit"); Accessible.name: qsTr("Show all of it"); onClicked: { panel._zoomed = false; panel.fit() } }
                }
            }
            Text {
                objectName: "canvasSaid"
                visible: text !== ""
                Layout.fillWidth: true
                text: panel.view.said || (panel.view.there && panel.view.problem ? qsTr("Not drawn as it stands: %1").arg(panel.view.problem)
                    : panel.open && panel.code.view.problem.message ? panel.code.view.problem.message : "")
                textFormat: Text.PlainText
                color: Theme.danger
                font.pixelSize: Theme.small
                wrapMode: Text.Wrap
                maximumLineCount: 4
                elide: Text.ElideRight
            }
        }

        ColumnLayout {
            visible: panel.open
            Layout.preferredWidth: Math.round(290 * Theme.scale)
            Layout.maximumWidth: Math.round(290 * Theme.scale)
            Layout.fillHeight: true
            spacing: Theme.tight

            RowLayout {
                Layout.fillWidth: true
                spacing: Theme.tight
                Column {
                    Layout.fillWidth: true
                    Text { width: parent.width; text: panel.code.view.title; color: Theme.text; font { pixelSize: Theme.large; weight: Font.DemiBold } elide: Text.ElideMiddle }
                    Text {
                        objectName: "canvasState"
                        width: parent.width
                        text: panel.code.view.dirty ? qsTr("not saved") : panel.code.view.release > 0 ? qsTr("saved as release %1").arg(panel.code.view.release) : panel.view.running ? qsTr("running") : qsTr("as the engine has it")
                        color: panel.code.view.dirty ? Theme.warning : Theme.muted
                        font.pixelSize: Theme.small
                        elide: Text.ElideRight
                    }
                }
                ActionButton {
                    objectName: "canvasSave"
                    Layout.minimumWidth: Math.round(104 * Theme.scale)
                    tone: "primary"
                    text: qsTr("Save")
                    why: Words.why(panel.code.view.whySave)
                    onClicked: panel.code.save("")
                }
            }
            RowLayout {
                visible: panel.code.view.theirs
                Layout.fillWidth: true
                spacing: Theme.tight
                ActionButton { objectName: "canvasTheirs"; Layout.fillWidth: true; text: qsTr("Take theirs"); onClicked: panel.code.revert() }
                ActionButton { objectName: "canvasMine"; Layout.fillWidth: true; text: qsTr("Keep mine"); onClicked: panel.code.overrule() }
            }
            CanvasForm {
                canvas: panel.canvas
                Layout.fillWidth: true
                Layout.fillHeight: true
            }
        }
    }
}
