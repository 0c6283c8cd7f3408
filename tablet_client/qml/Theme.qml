pragma Singleton
import QtQuick

// Colours, sizes and type, dark or light. Calm: colour is kept for state, and red for what is wrong.
QtObject {
    property real scale: 1.0 // set by Main from the window's size

    property bool dark: true

    readonly property color ground: dark ? "#0b0f13" : "#e7ecf1"
    readonly property color sceneTop: dark ? "#222b35" : "#f7fafc"
    readonly property color sceneBottom: dark ? "#0d1217" : "#c3ced9"
    readonly property color panel: dark ? "#141a20" : "#ffffff"
    readonly property color raised: dark ? "#1f2730" : "#edf1f5"
    readonly property color pressed: dark ? "#29333d" : "#d6dee6"
    readonly property color line: dark ? "#28323c" : "#c5ced8"
    readonly property color text: dark ? "#e9eef3" : "#141b22"
    readonly property color muted: dark ? "#9aa8b6" : "#4a5763"
    readonly property color faint: dark ? "#919eab" : "#56626d"
    readonly property color code: dark ? "#b9d7f2" : "#12466f"
    readonly property color accent: dark ? "#58b1ff" : "#1061ad"
    readonly property color accentDeep: dark ? "#1d5f9e" : "#1168b8"
    readonly property color textOnAccent: "#ffffff"
    readonly property color good: dark ? "#45c486" : "#136f41"
    readonly property color warning: dark ? "#f0b541" : "#825600"
    readonly property color danger: dark ? "#ff6d63" : "#b9221a"
    readonly property color stop: "#e3261c"
    readonly property color asks: dark ? "#16212c" : "#eaf3fc"
    readonly property color badGround: dark ? "#3a1315" : "#fdeceb"
    readonly property color badLine: dark ? "#8d3431" : "#d98983"
    readonly property color badText: dark ? "#ffb3ad" : "#9c1a12"
    readonly property color endGround: dark ? "#43191a" : "#fbe3e1"
    readonly property color endPressed: dark ? "#5a1c1a" : "#f2c5c1"

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
