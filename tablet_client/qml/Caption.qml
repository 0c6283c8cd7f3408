import QtQuick
import Handrail

Text {
    color: Theme.muted
    font.pixelSize: Math.round(12 * Theme.scale)
    font.weight: Font.DemiBold
    font.capitalization: Font.AllUppercase
    font.letterSpacing: 1
}
