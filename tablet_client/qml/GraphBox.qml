import QtQuick
import Handrail

// A part of a node that is made of nodes, or what comes in and goes out of all of it. Its ports are GraphPorts.
Item {
    id: box

    required property string name
    required property real boxX
    required property real boxY
    required property real boxWidth
    required property real boxHeight
    required property string title
    required property string node
    required property string kind // part, in, out
    required property string problem
    required property bool active
    required property bool selected
    property real zoom: 1
    signal touched()

    objectName: "part_" + (kind === "part" ? name : kind)
    x: boxX * zoom
    y: boxY * zoom
    width: boxWidth * zoom
    height: boxHeight * zoom
    Accessible.role: Accessible.Button
    Accessible.name: _title
    Accessible.description: (active ? qsTr("running") + ", " : "") + node + (problem ? ", " + problem : "")
    Accessible.onPressAction: touched()

    readonly property string _title: kind === "in" ? qsTr("inputs") : kind === "out" ? qsTr("outputs") : title

    Rectangle {
        anchors.fill: parent
        radius: Theme.radius * box.zoom
        color: box.active ? Qt.alpha(Theme.good, 0.18) : box.kind === "part" ? Theme.raised : Qt.alpha(Theme.panel, 0.6)
        border { width: box.selected ? 3 : box.active ? 2 : 1; color: box.selected ? Theme.accent : box.problem ? Theme.danger : box.active ? Theme.good : Theme.line }
    }
    Column {
        x: 12 * box.zoom
        y: 7 * box.zoom
        width: parent.width - 24 * box.zoom
        Text {
            width: parent.width
            text: box._title
            textFormat: Text.PlainText
            color: box.kind === "part" ? Theme.text : Theme.muted
            font { pixelSize: Math.max(1, Math.round(14 * box.zoom)); weight: Font.DemiBold }
            elide: Text.ElideRight
            horizontalAlignment: box.kind === "in" ? Text.AlignRight : Text.AlignLeft
        }
        Text {
            width: parent.width
            visible: text !== ""
            text: box.node
            textFormat: Text.PlainText
            color: box.problem ? Theme.danger : Theme.muted
            font.pixelSize: Math.max(1, Math.round(12 * box.zoom))
            elide: Text.ElideRight
        }
    }
}
