"""Who flies: learned, planned and scripted pilots behind one interface."""
