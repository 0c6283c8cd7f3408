pragma Singleton
import QtQuick

// Colours, sizes and type. Dark and calm: colour is kept for state, and red for what is wrong.
QtObject {
    property real scale: 1.0 // set by Main from the window's size

    readonly property color ground: "#0b0f13"
    readonly property color sceneTop: "#1a2129"
    readonly property color panel: "#141a20"
    readonly property color raised: "#1f2730"
    readonly property color pressed: "#2b3641"
    readonly property color line: "#28323c"
    readonly property color text: "#e9eef3"
    readonly property color muted: "#9aa8b6"
    readonly property color faint: "#6b7885"
    readonly property color accent: "#58b1ff"
    readonly property color accentDeep: "#1d5f9e"
    readonly property color good: "#45c486"
    readonly property color warning: "#f0b541"
    readonly property color danger: "#ff5c52"
    readonly property color stop: "#e3261c"
    readonly property color badGround: "#3a1315"
    readonly property color badLine: "#8d3431"
    readonly property color badText: "#ffb3ad"

    readonly property int small: Math.round(13 * scale)
    readonly property int body: Math.round(15 * scale)
    readonly property int large: Math.round(18 * scale)
    readonly property int title: Math.round(21 * scale)
    readonly property int huge: Math.round(30 * scale)

    readonly property int touch: Math.max(44, Math.round(48 * scale)) // no control is smaller than 44 px
    readonly property int gap: Math.round(12 * scale)
    readonly property int tight: Math.round(6 * scale)
    readonly property int radius: Math.round(10 * scale)

    function state(name) {
        return ({ good: good, warning: warning, error: danger, info: muted, accent: accent })[name] || muted
    }
}
