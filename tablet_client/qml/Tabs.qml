import QtQuick
import QtQuick.Controls.Basic
import Handrail

// Pages beside the scene, one at a time; in two rows where they are many. A dot says that a page should be looked at.
Grid {
    id: tabs

    property var pages: [] // {name, title, mark: a colour, or nothing}
    property string page: pages.length ? pages[0].name : ""

    columns: pages.length > 6 ? Math.ceil(pages.length / 2) : pages.length
    spacing: Math.round(4 * Theme.scale)
    Accessible.role: Accessible.PageTabList
    Accessible.name: qsTr("Pages")

    Repeater {
        model: tabs.pages
        AbstractButton {
            id: tab
            required property var modelData
            readonly property bool current: tabs.page === modelData.name
            objectName: "tab_" + modelData.name
            width: (tabs.width - (tabs.columns - 1) * tabs.spacing) / tabs.columns
            height: Theme.touch
            focusPolicy: Qt.StrongFocus
            text: modelData.title
            Accessible.role: Accessible.PageTab
            Accessible.name: text
            Accessible.checked: current
            onClicked: tabs.page = modelData.name
            Keys.onReturnPressed: click()
            Keys.onEnterPressed: click()
            background: Rectangle {
                radius: Theme.radius
                color: tab.current ? Theme.raised : tab.down ? Theme.pressed : "transparent"
                border { width: tab.visualFocus ? 2 : 1; color: tab.visualFocus ? Theme.accent : tab.current ? Theme.line : "transparent" }
            }
            contentItem: Item {
                Text {
                    anchors.centerIn: parent
                    width: parent.width - Theme.tight
                    horizontalAlignment: Text.AlignHCenter
                    fontSizeMode: Text.HorizontalFit
                    minimumPixelSize: 9
                    text: tab.text
                    color: tab.current ? Theme.text : Theme.muted
                    font.pixelSize: tabs.columns > 4 ? Theme.small : Theme.body
                    font.weight: tab.current ? Font.DemiBold : Font.Medium
                }
                Rectangle {
                    visible: !!tab.modelData.mark
                    anchors { top: parent.top; right: parent.right; margins: Math.round(9 * Theme.scale) }
                    width: Math.round(8 * Theme.scale); height: width; radius: width / 2
                    color: tab.modelData.mark || "transparent"
                }
            }
        }
    }
}
