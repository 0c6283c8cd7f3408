import QtQuick
import QtQuick.Controls.Basic
import Handrail

// Where a picture of a program, or of a node that is made of nodes, lies: scrolled, zoomed, with its lines.
Rectangle {
    id: area

    required property var canvas // the desk: view, curves, touchAt, beside, remove
    required property string opened // what is shown: each is fitted once
    required property bool can
    required property string name // accessible
    property real zoom: 1
    property string _fitted
    property bool _zoomed: false // by hand: it is not fitted again
    default property alias boxes: boxes.data
    readonly property var view: canvas.view

    color: Theme.ground
    radius: Theme.tight
    border { width: ground.activeFocus ? 2 : 1; color: ground.activeFocus ? Theme.accent : Theme.line }
    clip: true

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
    // Once for each that is opened.
    function settle() {
        if (!visible || !view.there || flick.width < 50) return
        if (_fitted !== opened) { _fitted = opened; _zoomed = false }
        if (_zoomed) return
        fit()
        if (zoom >= 0.6) return
        zoom = 0.6 // what is smaller can't be read: from where it begins, or is
        const start = view.start
        flick.contentX = Math.max(0, Math.min(start.x * zoom - flick.width / 2, flick.contentWidth - flick.width))
        flick.contentY = Math.max(0, Math.min(start.y * zoom - flick.height / 3, flick.contentHeight - flick.height))
    }
    // What was seen whole is seen whole as it grows.
    property var _size: [0, 0]
    onViewChanged: {
        if (!view.there) return
        const grown = view.width !== _size[0] || view.height !== _size[1]
        _size = [view.width, view.height]
        if (_fitted !== opened) settle()
        else if (grown && !_zoomed && Math.min((flick.width - 8) / view.width, (flick.height - 8) / view.height) >= 0.6) fit()
    }

    Flickable {
        id: flick
        objectName: "canvasView"
        anchors { fill: parent; margins: 2 }
        visible: area.view.there
        contentWidth: Math.max(width, area.view.width * area.zoom)
        contentHeight: Math.max(height, area.view.height * area.zoom)
        onWidthChanged: area.settle()
        onHeightChanged: area.settle()
        ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(8 * Theme.scale) }
        ScrollBar.horizontal: ScrollBar { policy: ScrollBar.AsNeeded; height: Math.round(8 * Theme.scale) }

        Item {
            id: ground
            width: flick.contentWidth
            height: flick.contentHeight
            activeFocusOnTab: true
            Accessible.role: Accessible.Canvas
            Accessible.name: area.name
            Keys.onRightPressed: area.canvas.beside(1)
            Keys.onDownPressed: area.canvas.beside(1)
            Keys.onLeftPressed: area.canvas.beside(-1)
            Keys.onUpPressed: area.canvas.beside(-1)
            Keys.onDeletePressed: if (area.can) area.canvas.remove()

            TapHandler {
                onTapped: point => {
                    ground.forceActiveFocus()
                    area.canvas.touchAt(point.position.x / area.zoom, point.position.y / area.zoom)
                }
            }
            WheelHandler {
                acceptedModifiers: Qt.ControlModifier
                onWheel: event => area.zoomTo(area.zoom * Math.pow(1.0015, event.angleDelta.y), event.x - flick.contentX, event.y - flick.contentY)
            }
            PinchHandler {
                target: null
                property real before: 1
                onActiveChanged: before = area.zoom
                onActiveScaleChanged: if (active) area.zoomTo(before * activeScale, centroid.position.x - flick.contentX, centroid.position.y - flick.contentY)
            }
            Item { id: boxes }
            CanvasLines {
                width: area.view.width * area.zoom
                height: area.view.height * area.zoom
                source: area.canvas
                zoom: area.zoom
                colors: ({ line: Theme.muted, words: Theme.code, chosen: Theme.accent, ground: Theme.ground })
            }
        }
    }
    Row {
        visible: area.view.there
        anchors { right: parent.right; bottom: parent.bottom; margins: Theme.gap }
        spacing: Theme.tight
        ActionButton { objectName: "canvasOut"; text: "−"; Accessible.name: qsTr("Smaller"); onClicked: area.zoomTo(area.zoom / 1.25, flick.width / 2, flick.height / 2) }
        ActionButton { objectName: "canvasIn"; text: "+"; Accessible.name: qsTr("Larger"); onClicked: area.zoomTo(area.zoom * 1.25, flick.width / 2, flick.height / 2) }
        ActionButton { objectName: "canvasFit"; text: qsTr("Fit"); Accessible.name: qsTr("Show all of it"); onClicked: { area._zoomed = false; area.fit() } }
    }
}
