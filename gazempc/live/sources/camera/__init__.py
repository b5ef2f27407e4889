"""A person in front of a camera: pictures, face detection, and head poses. May import gazempc.live."""
