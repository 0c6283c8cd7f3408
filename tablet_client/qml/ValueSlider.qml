import QtQuick
import QtQuick.Controls.Basic
import Handrail

// A number within bounds, with its unit.
Item {
    id: item

    required property string name
    required property string title
    required property string unit
    required property real value
    required property real low
    required property real high
    required property real step
    required property string text
    property string kind: "parameter"
    property string why: ""
    property bool titled: true // the title is shown, and not only said
    signal moved(real value)
    signal finished()

    implicitHeight: words.height + slider.height

    Item {
        id: words
        width: parent.width
        height: title.implicitHeight
        Text {
            id: title
            width: parent.width - shown.width - Theme.gap
            text: item.titled ? item.title : ""
            color: Theme.muted; font.pixelSize: Theme.small
            elide: Text.ElideRight
        }
        Text {
            id: shown
            anchors.right: parent.right
            text: item.text
            color: Theme.text; font.pixelSize: Theme.small; font.weight: Font.DemiBold; font.features: { "tnum": 1 }
        }
    }
    Slider {
        id: slider
        objectName: item.kind + "_" + item.name
        anchors { top: words.bottom; left: parent.left; right: parent.right }
        height: Theme.touch
        enabled: item.why === "" && item.high > item.low
        from: item.low
        to: item.high
        stepSize: item.step
        snapMode: item.step > 0 ? Slider.SnapAlways : Slider.NoSnap
        Accessible.role: Accessible.Slider
        Accessible.name: item.title
        Accessible.description: item.text
        onMoved: item.moved(value)
        onPressedChanged: if (!pressed) item.finished()
        Binding on value { value: item.value; when: !slider.pressed }
        readonly property real _key: item.step > 0 ? item.step : (item.high - item.low) / 100
        Keys.onLeftPressed: { item.moved(Math.max(from, value - _key)); item.finished() }
        Keys.onRightPressed: { item.moved(Math.min(to, value + _key)); item.finished() }
        background: Rectangle {
            x: slider.leftPadding
            y: slider.topPadding + slider.availableHeight / 2 - height / 2
            width: slider.availableWidth
            height: Math.round(5 * Theme.scale)
            radius: height / 2
            color: Theme.pressed
            Rectangle { width: slider.visualPosition * parent.width; height: parent.height; radius: height / 2; color: slider.enabled ? Theme.accent : Theme.faint }
        }
        handle: Rectangle {
            x: slider.leftPadding + slider.visualPosition * (slider.availableWidth - width)
            y: slider.topPadding + slider.availableHeight / 2 - height / 2
            width: Math.round(22 * Theme.scale); height: width; radius: width / 2
            color: slider.pressed ? "white" : slider.enabled ? Theme.text : Theme.faint
            border { width: slider.visualFocus ? 3 : 0; color: Theme.accent }
        }
    }
}
