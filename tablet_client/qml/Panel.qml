import QtQuick
import Handrail

Rectangle {
    color: Theme.panel
    radius: Theme.radius
    border.color: Theme.line
}
