"""The operator's window: what the robot is and does, what it is about to do, and the buttons that decide it.

Three floors: `session` (one connection, no Qt), `models` (what is known, plain Python, no Qt), and the window (`app`, `desk`,
`scene`, `qml`). Messages go up, calls go down; nothing in the window waits for the network.
"""
