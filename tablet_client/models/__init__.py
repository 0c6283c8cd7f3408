"""What the tablet knows, in plain Python: fed with messages, asked for views, tested without a screen."""
