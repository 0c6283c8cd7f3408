import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// The plan's time line: play the ghost, or put it anywhere along the plan.
Rectangle {
    id: bar

    readonly property var view: desk.ghost
    readonly property color tone: view.stale ? Theme.danger : Theme.accent

    objectName: "ghostBar"
    visible: view.shown && !desk.recordings.replay.active
    implicitHeight: column.implicitHeight + 2 * Theme.tight
    radius: Theme.radius
    color: Qt.alpha(Theme.panel, 0.9)
    border.color: view.stale ? Theme.danger : Theme.line

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; top: parent.top; margins: Theme.tight
                  leftMargin: Theme.gap; rightMargin: Theme.gap }
        spacing: 0

        Text {
            Layout.fillWidth: true
            Layout.topMargin: Math.round(3 * Theme.scale)
            objectName: "ghostReason"
            visible: bar.view.stale === true
            text: qsTr("Stale plan: %1").arg(bar.view.because || "")
            color: Theme.badText
            font.pixelSize: Theme.small
            elide: Text.ElideRight
        }
        // What the plan keeps at its worst. A tap puts the ghost there.
        RowLayout {
            Layout.fillWidth: true
            Layout.topMargin: Math.round(3 * Theme.scale)
            visible: bar.view.figures.length > 0
            spacing: Theme.gap
            Repeater {
                model: bar.view.figures
                Item {
                    id: cell
                    required property var modelData
                    objectName: "figure_" + modelData.code
                    Layout.fillWidth: true
                    Layout.preferredWidth: modelData.code === "clearance" ? 3 : 2
                    readonly property bool leads: modelData.at >= 0
                    function go() { if (leads) desk.scrub(modelData.at) }
                    implicitHeight: Math.max(44, words.implicitHeight)
                    activeFocusOnTab: leads
                    Keys.onReturnPressed: go()
                    Keys.onEnterPressed: go()
                    Accessible.role: leads ? Accessible.Button : Accessible.StaticText
                    Accessible.focusable: leads
                    Accessible.onPressAction: go()
                    Accessible.name: qsTr("%1 %2, %3").arg(Words.figure(modelData.code)).arg(modelData.text).arg(detail.text)
                    TapHandler { enabled: cell.leads; onTapped: cell.go() }
                    Rectangle {
                        anchors { fill: parent; margins: -2 }
                        visible: cell.activeFocus
                        color: "transparent"
                        radius: Theme.tight
                        border { width: 2; color: Theme.accent }
                    }
                    Column {
                        id: words
                        width: parent.width
                        anchors.verticalCenter: parent.verticalCenter
                        Row {
                            spacing: Theme.tight
                            Text {
                                id: figure
                                text: cell.modelData.text; color: Words.levelColor(cell.modelData.level)
                                font.pixelSize: Theme.body; font.weight: Font.DemiBold
                            }
                            Text {
                                anchors.baseline: figure.baseline
                                text: Words.figure(cell.modelData.code); color: Theme.muted; font.pixelSize: Math.round(12 * Theme.scale)
                            }
                        }
                        Text {
                            id: detail
                            width: parent.width
                            text: Words.about(cell.modelData)
                            color: Theme.faint; font.pixelSize: Math.round(11.5 * Theme.scale); elide: Text.ElideRight
                        }
                    }
                }
            }
        }
        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.gap

            AbstractButton {
                id: playButton
                objectName: "playGhost"
                implicitWidth: Theme.touch
                implicitHeight: Theme.touch
                focusPolicy: Qt.StrongFocus
                Accessible.role: Accessible.Button
                Accessible.name: bar.view.playing ? qsTr("Pause the ghost") : qsTr("Play the ghost")
                onClicked: desk.play(!bar.view.playing)
                Keys.onReturnPressed: click()
                Keys.onEnterPressed: click()
                background: Rectangle {
                    radius: height / 2
                    color: playButton.down ? Theme.pressed : Theme.raised
                    border { width: playButton.visualFocus ? 2 : 1; color: playButton.visualFocus ? Theme.accent : Theme.line }
                }
                contentItem: Item {
                    Row {
                        anchors.centerIn: parent
                        visible: bar.view.playing
                        spacing: Math.round(5 * Theme.scale)
                        Repeater { model: 2; Rectangle { width: Math.round(5 * Theme.scale); height: Math.round(17 * Theme.scale); radius: 1; color: Theme.text } }
                    }
                    Canvas {
                        anchors.centerIn: parent
                        anchors.horizontalCenterOffset: 2
                        visible: !bar.view.playing
                        width: Math.round(16 * Theme.scale); height: Math.round(18 * Theme.scale)
                        onPaint: {
                            const c = getContext("2d")
                            c.reset()
                            c.fillStyle = Theme.text
                            c.moveTo(0, 0); c.lineTo(width, height / 2); c.lineTo(0, height); c.closePath(); c.fill()
                        }
                    }
                }
            }
            Column {
                Layout.preferredWidth: Math.round(112 * Theme.scale)
                Text {
                    width: parent.width
                    text: bar.view.label || qsTr("Plan")
                    color: Theme.text; font.pixelSize: Theme.small; font.weight: Font.DemiBold; elide: Text.ElideRight
                }
                Text {
                    objectName: "ghostSegment"
                    width: parent.width
                    text: Words.name(bar.view.segment)
                    color: bar.tone; font.pixelSize: Theme.small; elide: Text.ElideRight
                }
            }
            Slider {
                id: slider
                objectName: "scrub"
                Layout.fillWidth: true
                implicitHeight: Theme.touch
                from: 0
                to: Math.max(bar.view.duration, 0.001)
                stepSize: 0
                onMoved: desk.scrub(value)
                Accessible.role: Accessible.Slider
                Accessible.name: qsTr("Position along the plan")
                Binding on value { value: desk.ghostTime; when: !slider.pressed }
                Keys.onLeftPressed: desk.scrub(slider.value - 0.1)
                Keys.onRightPressed: desk.scrub(slider.value + 0.1)

                background: Rectangle {
                    x: slider.leftPadding
                    y: slider.topPadding + slider.availableHeight / 2 - height / 2
                    width: slider.availableWidth
                    height: Math.round(6 * Theme.scale)
                    radius: height / 2
                    color: Theme.pressed
                    Rectangle {
                        width: slider.visualPosition * parent.width; height: parent.height; radius: height / 2
                        color: bar.tone
                    }
                    // Ways to waypoints that stand badly have the colour of that.
                    Repeater {
                        model: bar.view.marks
                        Rectangle {
                            required property var modelData
                            objectName: "way_" + modelData.name
                            x: modelData.at / slider.to * parent.width
                            width: (modelData.end - modelData.at) / slider.to * parent.width
                            height: parent.height; radius: parent.radius
                            visible: modelData.level !== "good" && !bar.view.stale
                            color: Words.levelColor(modelData.level)
                            opacity: 0.75
                        }
                    }
                    Repeater {
                        model: bar.view.marks
                        Rectangle {
                            required property var modelData
                            x: modelData.end / slider.to * parent.width - width / 2
                            anchors.verticalCenter: parent.verticalCenter
                            width: 2; height: Math.round(14 * Theme.scale)
                            color: modelData.level === "good" ? Theme.muted : Words.levelColor(modelData.level)
                        }
                    }
                    // Key frames that it passes.
                    Repeater {
                        model: bar.view.keys
                        Rectangle {
                            required property var modelData
                            x: modelData / slider.to * parent.width - width / 2
                            anchors.verticalCenter: parent.verticalCenter
                            width: Math.round(9 * Theme.scale); height: width; rotation: 45
                            color: Theme.text
                        }
                    }
                    // Where it comes nearest to anything.
                    Canvas {
                        objectName: "worstClearance"
                        readonly property color tone: Words.levelColor(bar.view.worstLevel)
                        visible: bar.view.worstAt >= 0
                        x: bar.view.worstAt / slider.to * parent.width - width / 2
                        anchors.bottom: parent.top
                        anchors.bottomMargin: Math.round(3 * Theme.scale)
                        width: Math.round(12 * Theme.scale); height: Math.round(9 * Theme.scale)
                        onToneChanged: requestPaint()
                        onPaint: {
                            const c = getContext("2d")
                            c.reset()
                            c.fillStyle = tone
                            c.moveTo(0, 0); c.lineTo(width, 0); c.lineTo(width / 2, height); c.closePath(); c.fill()
                        }
                    }
                }
                handle: Rectangle {
                    x: slider.leftPadding + slider.visualPosition * (slider.availableWidth - width)
                    y: slider.topPadding + slider.availableHeight / 2 - height / 2
                    width: Math.round(24 * Theme.scale); height: width; radius: width / 2
                    color: slider.pressed ? "white" : Theme.text
                    border { width: slider.visualFocus ? 3 : 0; color: Theme.accent }
                }
            }
            Text {
                Layout.preferredWidth: Math.round(96 * Theme.scale)
                horizontalAlignment: Text.AlignRight
                text: qsTr("%1 / %2 s").arg(desk.ghostTime.toFixed(1)).arg(bar.view.duration.toFixed(1))
                color: Theme.muted
                font.pixelSize: Theme.small
                font.features: { "tnum": 1 }
            }
            ActionButton {
                objectName: "execute"
                Layout.preferredWidth: Math.round(148 * Theme.scale)
                tone: "primary"
                text: qsTr("Execute")
                why: Words.why(bar.view.executeWhy || "")
                onClicked: desk.execute()
            }
        }
    }
}
