import QtQuick
import QtQuick.Shapes
import Handrail

// Degrees turned, out of a goal, as an arc.
Item {
    id: dial

    property real turned: 0
    property real goal: 0
    property color color: Theme.accent
    readonly property real _whole: 270 // the arc that stands for the goal
    readonly property real _share: goal > 0 ? Math.min(turned / goal, 1) : Math.min(turned / 360, 1)

    objectName: "dial"
    implicitWidth: Math.round(104 * Theme.scale)
    implicitHeight: Math.round(96 * Theme.scale)
    Accessible.role: Accessible.StaticText
    Accessible.name: goal > 0 ? qsTr("%1 degrees of %2").arg(Math.round(turned)).arg(Math.round(goal))
                              : qsTr("%1 degrees").arg(Math.round(turned))

    component Arc: ShapePath {
        id: arc
        property real sweep
        strokeWidth: Math.round(8 * Theme.scale)
        fillColor: "transparent"
        capStyle: ShapePath.RoundCap
        PathAngleArc {
            centerX: dial.width / 2; centerY: dial.width / 2
            radiusX: dial.width / 2 - 6 * Theme.scale; radiusY: radiusX
            startAngle: 135; sweepAngle: arc.sweep
        }
    }
    Shape {
        anchors.fill: parent
        preferredRendererType: Shape.CurveRenderer
        Arc { sweep: dial._whole; strokeColor: Theme.raised }
        Arc { sweep: Math.max(dial._whole * dial._share, 0.01); strokeColor: dial._share > 0 ? dial.color : "transparent" }
    }
    Column {
        anchors.centerIn: parent
        Text {
            objectName: "turned"
            anchors.horizontalCenter: parent.horizontalCenter
            text: Math.round(dial.turned) + "°"
            color: Theme.text
            font.pixelSize: Math.round(24 * Theme.scale)
            font.weight: Font.DemiBold
        }
        Text {
            anchors.horizontalCenter: parent.horizontalCenter
            visible: dial.goal > 0
            text: qsTr("of %1°").arg(Math.round(dial.goal))
            color: Theme.muted
            font.pixelSize: Math.round(12 * Theme.scale)
        }
    }
}
