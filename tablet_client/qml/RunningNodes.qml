import QtQuick
import QtQuick.Layouts
import Handrail

// The parameters of the nodes that run of what is open: set here, they count from the next step. A file keeps what it says.
ColumnLayout {
    id: column

    readonly property var nodes: desk.workshop.nodes

    spacing: Theme.tight

    Repeater {
        model: column.nodes.parameters
        ColumnLayout {
            id: row
            required property string node
            required property bool first
            required property string doc
            required property string name
            required property string title
            required property string type
            required property string unit
            required property var value
            required property real low
            required property real high
            required property bool bounded
            required property real step
            required property bool fits
            required property string expected
            required property var choices
            Layout.fillWidth: true
            spacing: Theme.tight
            Caption { visible: row.first; Layout.fillWidth: true; text: qsTr("%1, while it runs").arg(row.node); elide: Text.ElideRight }
            LaunchParameter {
                Layout.fillWidth: true
                kind: "running_" + row.node
                name: row.name
                title: row.title
                type: row.type
                unit: row.unit
                value: row.value
                low: row.low
                high: row.high
                bounded: row.bounded
                step: row.step
                fits: row.fits
                expected: row.expected
                choices: row.choices
                onTurned: number => column.nodes.turn(row.node, name, number)
                onSwitched: on => column.nodes.switch(row.node, name, on)
                onWritten: text => column.nodes.write(row.node, name, text)
            }
            Text {
                visible: text !== ""
                Layout.fillWidth: true
                text: row.doc
                textFormat: Text.PlainText
                color: Theme.muted; font.pixelSize: Theme.small; wrapMode: Text.Wrap
            }
        }
    }
    Text {
        objectName: "runningProblem"
        visible: text !== ""
        Layout.fillWidth: true
        text: column.nodes.problem
        textFormat: Text.PlainText
        color: Theme.danger; font.pixelSize: Theme.small; wrapMode: Text.Wrap
        Accessible.role: Accessible.AlertMessage
        Accessible.name: text
    }
}
