import QtQuick
import QtQuick.Controls.Basic
import Handrail

// The way to every page, in groups; scrolls where the window is low. A dot says that a page should be looked at.
Flickable {
    id: rail

    readonly property int _touch: Math.max(44, Math.round(44 * Theme.scale))

    objectName: "tabs"
    implicitWidth: Math.round(112 * Theme.scale)
    contentHeight: column.implicitHeight
    clip: true
    boundsBehavior: Flickable.StopAtBounds
    Accessible.role: Accessible.PageTabList
    Accessible.name: qsTr("Pages")
    ScrollBar.vertical: ScrollBar { policy: ScrollBar.AsNeeded; width: Math.round(4 * Theme.scale) }

    function reveal(tab) {
        contentY = Math.max(Math.min(contentY, tab.y), Math.min(tab.y + tab.height - height, contentHeight - height))
    }

    Column {
        id: column
        width: rail.width - Theme.tight
        spacing: Math.round(3 * Theme.scale)

        Repeater {
            model: Pages.all
            Column {
                id: entry
                required property var modelData
                required property int index
                readonly property bool first: index === 0 || Pages.all[index - 1].group !== modelData.group
                width: column.width

                Text {
                    visible: entry.first
                    leftPadding: Theme.tight
                    topPadding: entry.index ? Theme.tight : 0
                    bottomPadding: Math.round(3 * Theme.scale)
                    text: entry.modelData.group
                    color: Theme.faint
                    font { pixelSize: Math.round(11 * Theme.scale); weight: Font.DemiBold; letterSpacing: 0.6; capitalization: Font.AllUppercase }
                    Accessible.role: Accessible.StaticText
                    Accessible.name: text
                }
                AbstractButton {
                    id: tab
                    readonly property bool current: Pages.current === entry.modelData.name
                    readonly property color mark: Pages.marks[entry.modelData.name] || "transparent"
                    objectName: "tab_" + entry.modelData.name
                    width: parent.width
                    height: rail._touch
                    focusPolicy: Qt.StrongFocus
                    text: entry.modelData.title
                    Accessible.role: Accessible.PageTab
                    Accessible.name: text
                    Accessible.checkable: true
                    Accessible.checked: current
                    onClicked: Pages.open(entry.modelData.name)
                    onActiveFocusChanged: if (activeFocus) rail.reveal(entry)
                    onCurrentChanged: if (current) rail.reveal(entry)
                    Keys.onReturnPressed: click()
                    Keys.onEnterPressed: click()
                    Keys.onUpPressed: nextItemInFocusChain(false).forceActiveFocus(Qt.BacktabFocusReason)
                    Keys.onDownPressed: nextItemInFocusChain(true).forceActiveFocus(Qt.TabFocusReason)
                    background: Rectangle {
                        radius: Theme.radius
                        color: tab.current ? Theme.raised : tab.down ? Theme.pressed : "transparent"
                        border { width: tab.visualFocus ? 2 : 1; color: tab.visualFocus ? Theme.accent : tab.current ? Theme.line : "transparent" }
                        Rectangle {
                            visible: tab.current
                            anchors { left: parent.left; top: parent.top; bottom: parent.bottom; margins: Theme.tight }
                            width: Math.round(3 * Theme.scale); radius: width / 2
                            color: Theme.accent
                        }
                    }
                    contentItem: Item {
                        Text {
                            anchors { verticalCenter: parent.verticalCenter; left: parent.left; right: parent.right
                                      leftMargin: Math.round(14 * Theme.scale); rightMargin: Theme.tight }
                            fontSizeMode: Text.HorizontalFit
                            minimumPixelSize: 9
                            text: tab.text
                            color: tab.current ? Theme.text : Theme.muted
                            font.pixelSize: Theme.body
                            font.weight: tab.current ? Font.DemiBold : Font.Medium
                        }
                        Rectangle {
                            objectName: "mark_" + entry.modelData.name
                            visible: tab.mark.a > 0
                            anchors { verticalCenter: parent.verticalCenter; right: parent.right; rightMargin: Math.round(8 * Theme.scale) }
                            width: Math.round(8 * Theme.scale); height: width; radius: width / 2
                            color: tab.mark
                        }
                    }
                }
            }
        }
    }
}
