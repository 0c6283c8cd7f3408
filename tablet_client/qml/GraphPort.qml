import QtQuick
import Handrail

// A port on the edge of its box: its name, its dot, and from the dot a wire that is drawn to another port.
Item {
    id: socket

    required property string box
    required property string port
    required property bool out // something comes out of it there
    required property real atX
    required property real atY
    required property bool known
    required property bool selected
    required property string value // newest, of an own port of what runs
    property real zoom: 1
    property bool can: false
    property bool aimed: false // a wire may end here
    signal joined(real x, real y) // in the picture's pixels

    objectName: "port_" + box.replace(":", "") + "_" + port + (out ? "_out" : "_in")
    x: atX * zoom
    y: atY * zoom

    Rectangle {
        anchors.centerIn: parent
        width: (socket.selected ? 16 : 12) * socket.zoom
        height: width
        radius: width / 2
        color: !socket.known ? Theme.danger : socket.selected || socket.aimed ? Theme.accent : Theme.panel
        border { width: 2; color: !socket.known ? Theme.danger : socket.selected || socket.aimed ? Theme.accent : Theme.muted }
    }
    Text {
        anchors.verticalCenter: parent.verticalCenter
        anchors.left: socket.out ? undefined : parent.left
        anchors.right: socket.out ? parent.left : undefined
        anchors.margins: 12 * socket.zoom
        text: socket.value === "" ? socket.port : socket.out ? socket.value + "  " + socket.port : socket.port + "  " + socket.value
        textFormat: Text.PlainText
        color: !socket.known ? Theme.danger : socket.selected ? Theme.accent : Theme.text
        font.pixelSize: Math.max(1, Math.round(12.5 * socket.zoom))
    }
    Item {
        id: grip
        anchors.centerIn: parent
        width: Math.max(Theme.touch * 0.7, 28 * socket.zoom)
        height: Math.min(width, 30 * socket.zoom)
        DragHandler {
            id: drag
            enabled: socket.can
            target: null
            onActiveChanged: {
                const there = grip.mapToItem(socket.parent, centroid.position.x, centroid.position.y)
                if (!active) socket.joined(there.x / socket.zoom, there.y / socket.zoom)
            }
        }
    }
    Rectangle { // the wire that is being drawn
        visible: drag.active
        readonly property real dx: drag.activeTranslation.x
        readonly property real dy: drag.activeTranslation.y
        width: Math.hypot(dx, dy)
        height: 2
        color: Theme.accent
        transformOrigin: Item.Left
        rotation: Math.atan2(dy, dx) * 180 / Math.PI
    }
}
