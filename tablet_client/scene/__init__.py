"""The 3-D view's contents: the robot's bodies, the ghost, templates, and their way into Qt Quick 3D."""
