import QtQuick
import QtQuick.Controls.Basic
import Handrail

// One state of a program's picture. What runs lights up; from the handle of the selected one a line is drawn to another state.
Item {
    id: box

    required property string name
    required property real boxX
    required property real boxY
    required property real boxWidth
    required property real boxHeight
    required property string title
    required property string does
    required property string kind // state, parallel, history, succeeded, failed, final
    required property bool initial
    required property bool holds
    required property bool active
    required property bool selected
    property real zoom: 1
    property bool joining: false
    signal touched()
    signal joined(real x, real y) // in the picture's pixels

    objectName: "state_" + name
    x: boxX * zoom
    y: boxY * zoom
    width: boxWidth * zoom
    height: boxHeight * zoom
    Accessible.role: Accessible.Button
    Accessible.name: title
    Accessible.description: (active ? qsTr("running") + ", " : "") + (does || kind)
    Accessible.onPressAction: touched()

    readonly property color _edge: selected ? Theme.accent : active ? Theme.good : kind === "failed" ? Theme.danger : kind === "succeeded" ? Theme.good : joining ? Theme.accent : Theme.line

    Rectangle {
        anchors.fill: parent
        radius: box.kind === "state" || box.kind === "parallel" ? Theme.radius * box.zoom : height / 2
        color: box.active ? Qt.alpha(Theme.good, box.holds ? 0.10 : 0.25) : box.holds ? Qt.alpha(Theme.panel, 0.6) : Theme.raised
        border { width: box.selected ? 3 : box.active ? 2 : 1; color: box._edge }
    }
    Rectangle { // a final state has two lines around it
        visible: ["succeeded", "failed", "final"].includes(box.kind)
        anchors { fill: parent; margins: 3 }
        radius: height / 2
        color: "transparent"
        border { width: 1; color: box._edge }
    }
    Column {
        x: 12 * box.zoom
        width: parent.width - 24 * box.zoom
        y: box.holds ? 6 * box.zoom : (parent.height - height) / 2
        Text {
            width: parent.width
            text: (box.initial ? "● " : "") + box.title
            textFormat: Text.PlainText
            color: Theme.text
            font { pixelSize: Math.max(1, Math.round(14 * box.zoom)); weight: Font.DemiBold }
            elide: Text.ElideRight
            horizontalAlignment: box.holds ? Text.AlignLeft : Text.AlignHCenter
        }
        Text {
            width: parent.width
            visible: text !== ""
            text: box.does || (box.kind === "parallel" ? qsTr("side by side") : "")
            textFormat: Text.PlainText
            color: Theme.muted
            font.pixelSize: Math.max(1, Math.round(12 * box.zoom))
            elide: Text.ElideRight
            horizontalAlignment: box.holds ? Text.AlignLeft : Text.AlignHCenter
        }
    }

    Rectangle { // drag it to where a new way should lead
        id: handle
        visible: box.selected
        anchors { horizontalCenter: parent.horizontalCenter; top: parent.bottom; topMargin: -Math.round(10 * Theme.scale) }
        width: Theme.touch
        height: Theme.touch
        color: "transparent"
        Rectangle {
            anchors { horizontalCenter: parent.horizontalCenter; top: parent.top }
            width: Math.round(20 * Theme.scale); height: width; radius: width / 2
            color: Theme.accent
            border { width: 2; color: Theme.panel }
        }
        DragHandler {
            id: drag
            target: null
            onActiveChanged: {
                const at = centroid.position
                const there = handle.mapToItem(box.parent, at.x, at.y)
                if (!active) box.joined(there.x / box.zoom, there.y / box.zoom)
            }
        }
    }
    Rectangle { // the line that is being drawn
        visible: drag.active
        readonly property real dx: drag.activeTranslation.x
        readonly property real dy: drag.activeTranslation.y
        x: box.width / 2
        y: box.height
        width: Math.hypot(dx, dy)
        height: 2
        color: Theme.accent
        transformOrigin: Item.Left
        rotation: Math.atan2(dy, dx) * 180 / Math.PI
    }
}
