import QtQuick
import QtQuick.Controls.Basic
import QtQuick.Layouts
import Handrail

// What the robot could run, bound and started here; and which code its engines have, with the way back.
Panel {
    id: panel

    readonly property var view: desk.library.view
    property string part: "programs" // programs, engines
    readonly property bool _looks: visible && part === "engines"
    on_LooksChanged: desk.library.open(_looks)

    ColumnLayout {
        anchors { fill: parent; margins: Math.round(14 * Theme.scale) }
        spacing: Theme.gap

        RowLayout {
            Layout.fillWidth: true
            spacing: Theme.tight
            Repeater {
                model: [{ name: "programs", title: qsTr("Programs") }, { name: "engines", title: qsTr("Engines' code") }]
                ActionButton {
                    required property var modelData
                    objectName: "library_" + modelData.name
                    Layout.fillWidth: true
                    Layout.preferredWidth: 1
                    text: modelData.title
                    checked: panel.part === modelData.name
                    Accessible.role: Accessible.PageTab
                    Accessible.checkable: true
                    Accessible.checked: checked
                    onClicked: panel.part = modelData.name
                }
            }
        }
        ProgramList { visible: panel.part === "programs" && panel.view.program === ""; Layout.fillWidth: true; Layout.fillHeight: true }
        LaunchForm { visible: panel.part === "programs" && panel.view.program !== ""; Layout.fillWidth: true; Layout.fillHeight: true }
        EnginesList { visible: panel.part === "engines"; Layout.fillWidth: true; Layout.fillHeight: true }
    }
}
