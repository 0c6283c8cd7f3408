import QtQuick
import QtQuick3D

// Vertex colours under a sky, lit at the vertices: where the processor draws, light computed at every pixel takes most of a frame.
CustomMaterial {
    property real lit: 1 // 0: as bright as its colours are
    property color tint: "white"
    property real glow: 0 // of the tint, added
    property real point: 0 // pixels, of a point that is 1 m away

    shadingMode: CustomMaterial.Unshaded
    vertexShader: "paint.vert"
    fragmentShader: "paint.frag"
}
