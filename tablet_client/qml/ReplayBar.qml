import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// A recording's time line, in a colour of its own: what the scene shows is not now.
Rectangle {
    id: bar

    readonly property var view: desk.recordings.replay

    objectName: "replayBar"
    visible: view.active
    implicitHeight: column.implicitHeight + 2 * Theme.tight
    radius: Theme.radius
    color: Qt.alpha(Theme.panel, 0.94)
    border { color: Theme.warning; width: 2 }

    ColumnLayout {
        id: column
        anchors { left: parent.left; right: parent.right; top: parent.top; margins: Theme.tight; leftMargin: Theme.gap; rightMargin: Theme.gap }
        spacing: Math.round(4 * Theme.scale)

        RowLayout {
            Layout.fillWidth: true
            Layout.topMargin: 2
            spacing: Theme.gap
            Rectangle {
                color: Theme.warning; radius: Theme.tight
                implicitWidth: tag.implicitWidth + 2 * Theme.tight; implicitHeight: tag.implicitHeight + 4
                Text { id: tag; objectName: "replayTag"; anchors.centerIn: parent; text: qsTr("REPLAY"); color: Theme.ground; font.pixelSize: Theme.small; font.weight: Font.Bold; font.letterSpacing: 1 }
            }
            Text { Layout.fillWidth: true; text: bar.view.name; color: Theme.text; font.pixelSize: Theme.small; elide: Text.ElideRight }
            Text {
                objectName: "replayProblem"
                visible: text !== ""
                text: bar.view.problem && bar.view.waiting ? qsTr("not here: %1").arg(bar.view.problem) : bar.view.waiting ? qsTr("being fetched …") : ""
                color: Theme.warning; font.pixelSize: Theme.small; elide: Text.ElideRight
                Layout.maximumWidth: bar.width / 2
            }
        }
        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.gap
            ActionButton {
                objectName: "playReplay"
                Layout.preferredWidth: Math.round(84 * Theme.scale)
                text: bar.view.playing ? qsTr("Pause") : qsTr("Play")
                Accessible.name: bar.view.playing ? qsTr("Pause the replay") : qsTr("Play the replay")
                onClicked: desk.recordings.play(!bar.view.playing)
            }
            Slider {
                id: slider
                objectName: "scrubReplay"
                Layout.fillWidth: true
                implicitHeight: Theme.touch
                from: 0
                to: Math.max(bar.view.duration, 0.001)
                onMoved: desk.recordings.scrub(value)
                Accessible.role: Accessible.Slider
                Accessible.name: qsTr("Position along the recording")
                Binding on value { value: desk.recordings.time; when: !slider.pressed }
                Keys.onLeftPressed: desk.recordings.scrub(slider.value - 1)
                Keys.onRightPressed: desk.recordings.scrub(slider.value + 1)
                background: Rectangle {
                    x: slider.leftPadding
                    y: slider.topPadding + slider.availableHeight / 2 - height / 2
                    width: slider.availableWidth
                    height: Math.round(6 * Theme.scale); radius: height / 2
                    color: Theme.pressed
                    Rectangle { width: slider.visualPosition * parent.width; height: parent.height; radius: height / 2; color: Theme.warning }
                    Repeater {
                        model: bar.view.marks
                        Rectangle {
                            required property var modelData
                            x: modelData.at / slider.to * parent.width - width / 2
                            anchors.verticalCenter: parent.verticalCenter
                            width: Math.round(9 * Theme.scale); height: width; rotation: 45
                            color: Theme.text
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
                objectName: "replayTime"
                text: qsTr("%1 / %2").arg(Words.minutes(desk.recordings.time)).arg(Words.minutes(bar.view.duration))
                color: Theme.muted; font.pixelSize: Theme.small; font.features: { "tnum": 1 }
            }
            ActionButton {
                objectName: "endReplay"
                tone: "primary"
                text: qsTr("Back to live")
                onClicked: desk.recordings.back()
            }
        }
    }
}
