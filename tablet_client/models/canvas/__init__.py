"""A program as a picture that is edited: states in states, and the ways between them."""
