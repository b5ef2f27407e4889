"""A person in front of a camera: pictures, faces in them, and where they are. May import gazempc.live."""
