import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// All that can be done with the selected object, where the finger is. A touch beside it, or Close, takes it away.
Item {
    id: menu

    readonly property var view: desk.bench.view
    readonly property string selected: view.selected
    property string part: "all" // all, attach, save
    property point at

    visible: false
    onSelectedChanged: if (!selected) visible = false

    function show(where) {
        at = where
        part = "all"
        visible = true
        desk.bench.forgetSaved()
        close.forceActiveFocus(Qt.PopupFocusReason)
    }
    function look(section) {
        visible = false
        Pages.open("objects", section)
    }

    TapHandler { gesturePolicy: TapHandler.WithinBounds; onTapped: menu.visible = false }
    WheelHandler { acceptedDevices: PointerDevice.Mouse | PointerDevice.TouchPad }

    Rectangle {
        id: card
        readonly property real _gap: Theme.gap
        width: Math.round(248 * Theme.scale)
        height: Math.min(column.implicitHeight + 2 * Theme.gap, menu.height - 2 * Theme.gap)
        x: Math.max(_gap, Math.min(menu.at.x, menu.width - width - _gap))
        y: Math.max(_gap, Math.min(menu.at.y, menu.height - height - _gap))
        radius: Theme.radius
        color: Theme.panel
        border.color: Theme.line
        Accessible.role: Accessible.PopupMenu
        Accessible.name: qsTr("What can be done with %1").arg(menu.selected)

        TapHandler {} // keeps what is beneath from it

        Flickable {
            id: flick
            anchors { fill: parent; margins: Theme.gap }
            contentHeight: column.implicitHeight
            clip: true
            boundsBehavior: Flickable.StopAtBounds

            ColumnLayout {
                id: column
                width: flick.width
                spacing: Theme.tight

                component Entry: ActionButton { Layout.fillWidth: true }

                RowLayout {
                    Layout.fillWidth: true
                    Text {
                        Layout.fillWidth: true
                        text: menu.part === "attach" ? qsTr("%1 goes along with").arg(menu.selected)
                            : menu.part === "save" ? qsTr("A template of %1").arg(menu.selected) : menu.selected
                        color: Theme.text
                        font { pixelSize: Theme.body; weight: Font.DemiBold }
                        wrapMode: Text.Wrap
                    }
                    ActionButton {
                        id: close
                        objectName: "menuClose"
                        text: menu.part === "all" ? qsTr("Close") : qsTr("Back")
                        onClicked: if (menu.part === "all") menu.visible = false; else menu.part = "all"
                    }
                }

                Entry { objectName: "menuWaypoints"; visible: menu.part === "all" && menu.view.trajectories.length > 0; text: qsTr("Waypoints"); onClicked: menu.look("waypoints") }
                Entry { objectName: "menuParameters"; visible: menu.part === "all"; text: qsTr("Parameters"); onClicked: menu.look("parameters") }
                Entry { objectName: "menuJoints"; visible: menu.part === "all" && menu.view.hasJoints; text: qsTr("Joint state"); onClicked: menu.look("joints") }
                Entry { objectName: "menuAttach"; visible: menu.part === "all"; text: qsTr("Attach …"); why: menu.view.targets.length ? Words.why(menu.view.why.attach) : qsTr("nothing to go along with"); onClicked: menu.part = "attach" }
                Entry { objectName: "menuCopy"; visible: menu.part === "all"; text: qsTr("Copy"); why: Words.why(menu.view.why.copy); onClicked: { menu.visible = false; desk.bench.do("copy") } }
                Entry { objectName: "menuSave"; visible: menu.part === "all"; text: qsTr("Save as a template …"); why: Words.why(menu.view.why.save); onClicked: menu.part = "save" }
                Entry {
                    property bool sure: false
                    objectName: "menuDelete"
                    visible: menu.part === "all"
                    tone: "danger"
                    text: sure ? qsTr("Really delete") : qsTr("Delete")
                    why: Words.why(menu.view.why.delete)
                    onClicked: { if (sure) desk.bench.do("delete"); sure = !sure }
                    onVisibleChanged: sure = false
                }

                Repeater {
                    model: menu.part === "attach" ? menu.view.targets : []
                    Entry {
                        required property var modelData
                        objectName: "attach_" + (modelData.name || "world")
                        text: modelData.kind === "world" ? qsTr("Nothing: it stands") : Words.name(modelData.name)
                        checked: modelData.now
                        why: Words.why(menu.view.why.attach)
                        Accessible.checkable: true
                        Accessible.checked: checked
                        onClicked: { menu.visible = false; desk.bench.attach(modelData.kind, modelData.name) }
                    }
                }

                TextField {
                    id: name
                    objectName: "templateName"
                    visible: menu.part === "save"
                    Layout.fillWidth: true
                    Layout.preferredHeight: Theme.touch
                    color: Theme.text
                    placeholderText: qsTr("Name of the template")
                    placeholderTextColor: Theme.faint
                    font.pixelSize: Theme.body
                    inputMethodHints: Qt.ImhNoPredictiveText | Qt.ImhLowercaseOnly
                    validator: RegularExpressionValidator { regularExpression: /^[A-Za-z_][A-Za-z0-9_]*$/ }
                    Accessible.role: Accessible.EditableText
                    Accessible.name: placeholderText
                    Keys.onEscapePressed: desk.stop()
                    Keys.onSpacePressed: desk.stop()
                    Keys.onReturnPressed: save.click()
                    Keys.onEnterPressed: save.click()
                    onVisibleChanged: if (visible) { text = ""; forceActiveFocus(Qt.PopupFocusReason) }
                    background: Rectangle {
                        radius: Theme.tight
                        color: Theme.ground
                        border { width: name.activeFocus ? 2 : 1; color: name.activeFocus ? Theme.accent : Theme.line }
                    }
                }
                Entry {
                    id: save
                    objectName: "saveTemplate"
                    visible: menu.part === "save"
                    tone: "primary"
                    text: qsTr("Save")
                    why: name.text === "" ? qsTr("it has no name yet") : Words.why(menu.view.why.save)
                    onClicked: desk.bench.saveTemplate(name.text)
                }
                Text {
                    objectName: "templateSaid"
                    visible: menu.part === "save" && text !== ""
                    Layout.fillWidth: true
                    text: menu.view.saved.code === "saved" ? qsTr("Saved on the robot's computer: %1").arg(menu.view.saved.text)
                        : menu.view.saved.code === "not_saved" ? menu.view.saved.text : ""
                    color: menu.view.saved.code === "saved" ? Theme.good : Theme.danger
                    font.pixelSize: Theme.small
                    wrapMode: Text.Wrap
                    Accessible.role: Accessible.StaticText
                    Accessible.name: text
                }
            }
        }
    }
}
