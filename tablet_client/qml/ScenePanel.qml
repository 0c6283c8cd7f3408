import QtQuick
import Handrail

// The scene with its gestures, view buttons and the ghost's time line.
Rectangle {
    id: panel

    property alias scene: scene
    property int smoothing: 0
    property string look: "robot" // the view to begin with, as soon as there is something to look at
    readonly property bool _lookable: stage.state === "ready" && (look !== "work" || desk.header.places.length > 0)
    on_LookableChanged: if (_lookable) scene.rig.preset(look)

    radius: Theme.radius
    border.color: input.activeFocus && input.byKeyboard ? Theme.accent : Theme.line
    gradient: Gradient {
        GradientStop { position: 0.0; color: Theme.sceneTop }
        GradientStop { position: 1.0; color: Theme.sceneBottom }
    }
    clip: true

    Scene { id: scene; anchors { fill: parent; margins: 1 } smoothing: panel.smoothing }

    // One finger or the left button orbits, two fingers or the right button pan, pinch or wheel zooms.
    Item {
        id: input
        property bool byKeyboard: focusReason === Qt.TabFocusReason || focusReason === Qt.BacktabFocusReason
        property int focusReason: Qt.OtherFocusReason

        objectName: "sceneInput"
        anchors.fill: parent
        activeFocusOnTab: true
        Accessible.role: Accessible.Graphic
        Accessible.name: qsTr("The robot and its surroundings. Arrow keys turn the view, plus and minus zoom, digits choose a view, C shows what the camera sees.")

        // A finger that comes down on the handle of what is selected drags that, and nothing else.
        PointHandler {
            id: finger
            readonly property bool grasps: desk.bench.hot !== ""
            property bool grasped: false // until the next one comes down: a tap is told only when this one has been lifted
            acceptedButtons: Qt.LeftButton
            onActiveChanged: {
                if (active) grasped = desk.bench.grasp(point.position.x - 1, point.position.y - 1, scene.seen()) !== ""
                else desk.bench.release()
                if (active && !grasps) resting.restart()
                else resting.stop()
            }
            onPointChanged: {
                if (active && grasps) desk.bench.drag(point.position.x - 1, point.position.y - 1, scene.seen())
                const way = point.position, from = point.pressPosition
                if (Math.hypot(way.x - from.x, way.y - from.y) > 10) resting.stop()
            }
        }
        // Not a TapHandler's long press: that comes also when the handle has taken the finger meanwhile.
        Timer {
            id: resting
            interval: 600
            onTriggered: if (finger.active && !pinch.active) input.ask(finger.point.position)
        }
        DragHandler {
            property point last
            enabled: !finger.grasps
            target: null
            acceptedButtons: Qt.LeftButton
            maximumPointCount: 1
            onActiveChanged: last = Qt.point(0, 0)
            onActiveTranslationChanged: if (active) {
                scene.rig.orbit(activeTranslation.x - last.x, activeTranslation.y - last.y)
                last = Qt.point(activeTranslation.x, activeTranslation.y)
            }
        }
        DragHandler {
            property point last
            target: null
            acceptedButtons: Qt.RightButton | Qt.MiddleButton
            acceptedDevices: PointerDevice.Mouse | PointerDevice.TouchPad
            onActiveChanged: last = Qt.point(0, 0)
            onActiveTranslationChanged: if (active) {
                scene.rig.pan(activeTranslation.x - last.x, activeTranslation.y - last.y, scene.height)
                last = Qt.point(activeTranslation.x, activeTranslation.y)
            }
        }
        PinchHandler {
            id: pinch
            enabled: !finger.grasps
            target: null
            onScaleChanged: delta => scene.rig.zoom(delta)
            onTranslationChanged: delta => scene.rig.pan(delta.x, delta.y, scene.height)
        }
        WheelHandler {
            acceptedDevices: PointerDevice.Mouse | PointerDevice.TouchPad
            onWheel: event => scene.rig.zoom(Math.pow(1.12, event.angleDelta.y / 120))
        }
        // Not by `enabled`: the finger that moved the handle a little is lifted before this hears of it, and would be a tap beside.
        TapHandler {
            onSingleTapped: point => {
                if (!finger.grasped) desk.bench.tap(point.position.x - 1, point.position.y - 1, scene.seen())
            }
            onDoubleTapped: if (!finger.grasped) scene.rig.preset("robot")
            longPressThreshold: resting.interval / 1000 // what rests so long is no tap
        }
        TapHandler {
            enabled: !finger.grasps
            acceptedButtons: Qt.RightButton
            acceptedDevices: PointerDevice.Mouse
            onTapped: point => input.ask(point.position)
        }
        // A finger that rests on an object, or the right button: what can be done with it.
        function ask(at) {
            if (desk.bench.tap(at.x - 1, at.y - 1, scene.seen())) menu.show(at)
        }

        Keys.onLeftPressed: scene.rig.orbit(30, 0)
        Keys.onRightPressed: scene.rig.orbit(-30, 0)
        Keys.onUpPressed: scene.rig.orbit(0, 30)
        Keys.onDownPressed: scene.rig.orbit(0, -30)
        Keys.onPressed: event => {
            if (event.text === "+" || event.text === "=") scene.rig.zoom(1.15)
            else if (event.text === "-") scene.rig.zoom(1 / 1.15)
            else if (event.text >= "1" && event.text <= "5") scene.rig.preset(views.names[Number(event.text) - 1])
            else if (event.text.toLowerCase() === "c" && cloudButton.enabled) cloudButton.click()
            else return
            event.accepted = true
        }
    }

    Flow {
        id: views
        visible: stage.state === "ready"
        readonly property var names: ["robot", "work", "front", "side", "top"]
        readonly property var titles: [qsTr("Robot"), qsTr("Work"), qsTr("Front"), qsTr("Side"), qsTr("Top")]
        anchors { top: parent.top; left: parent.left; right: seen.left; margins: Theme.gap }
        spacing: Theme.tight
        Repeater {
            model: views.names
            ActionButton {
                required property int index
                required property string modelData
                objectName: "view_" + modelData
                text: views.titles[index]
                why: modelData === "work" && desk.header.places.length === 0 ? qsTr("nothing placed") : ""
                opacity: 0.94
                Accessible.name: qsTr("View: %1").arg(text)
                onClicked: scene.rig.preset(modelData)
            }
        }
    }
    Column {
        id: seen
        visible: stage.state === "ready"
        anchors { top: parent.top; right: parent.right; margins: Theme.gap }
        spacing: Theme.tight
        ActionButton {
            id: cloudButton
            objectName: "cloud"
            anchors.right: parent.right
            text: qsTr("Camera")
            why: desk.header.cloudAge === -1 ? qsTr("sees nothing") : ""
            checked: stage.cloudOn && why === ""
            opacity: 0.94
            Accessible.name: qsTr("Show what the robot's camera sees")
            Accessible.checkable: true
            Accessible.checked: checked
            onClicked: stage.showCloud(!stage.cloudOn)
        }
        Text {
            objectName: "cloudAge"
            anchors.right: parent.right
            visible: cloudButton.checked && (desk.header.cloudAge > 2 || desk.header.cloudAge === -2)
            text: desk.header.cloudAge === -2 ? qsTr("what it saw is old") : qsTr("what it saw is %1 s old").arg(desk.header.cloudAge)
            color: Theme.warning
            font.pixelSize: Theme.small
        }
        ActionButton {
            objectName: "inset"
            anchors.right: parent.right
            text: qsTr("Picture")
            why: cloudButton.why
            checked: desk.camera.view.open
            opacity: 0.94
            Accessible.name: qsTr("Show what the camera sees from where it stands")
            Accessible.checkable: true
            Accessible.checked: checked
            onClicked: desk.camera.open(!desk.camera.view.open)
        }
        CameraInset { anchors.right: parent.right }
    }
    Column {
        anchors { top: views.bottom; left: parent.left; right: parent.right; margins: Theme.gap
                  topMargin: Theme.gap + (desk.bench.view.selected ? context.height + Theme.gap : 0) }
        Text {
            objectName: "baseUnknown"
            width: parent.width
            visible: text !== ""
            text: stage.baseSource === "none" ? qsTr("Where the robot stands is not known: %1").arg(stage.baseProblem)
                : stage.baseSource === "inertial" ? qsTr("No foot holds: where the robot is, is less and less known") : ""
            color: Theme.warning
            font.pixelSize: Theme.small
            wrapMode: Text.Wrap
        }
        Repeater {
            model: stage.problems
            Text {
                required property var modelData
                width: parent.width
                text: modelData.why === "differs"
                    ? qsTr("%1: the robot uses another version of this template than this tablet draws").arg(modelData.name)
                    : qsTr("%1 can't be drawn: %2").arg(modelData.name).arg(modelData.why)
                color: Theme.warning
                font.pixelSize: Theme.small
                wrapMode: Text.Wrap
            }
        }
    }
    ContextBar { id: context; onMore: menu.show(Qt.point(x, y + height + Theme.gap)); anchors { top: views.bottom; left: parent.left; right: seen.left; margins: Theme.gap } }
    ReplayBar { anchors { left: parent.left; right: parent.right; bottom: parent.bottom; margins: Theme.gap } }
    GhostBar { anchors { left: parent.left; right: parent.right; bottom: parent.bottom; margins: Theme.gap } }
    ObjectMenu { id: menu; objectName: "objectMenu"; anchors.fill: parent }
    EmptyScene { anchors.fill: parent }
}
