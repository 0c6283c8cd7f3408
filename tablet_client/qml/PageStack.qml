import QtQuick
import Handrail

// The page that is open. One that was shown once is kept, with what the operator did on it.
Item {
    Repeater {
        model: Pages.all
        Loader {
            required property var modelData
            readonly property bool current: Pages.current === modelData.name
            objectName: "page_" + modelData.name
            anchors.fill: parent
            visible: current
            active: false
            source: modelData.file
            onCurrentChanged: if (current) active = true
            Component.onCompleted: if (current) active = true
        }
    }
}
