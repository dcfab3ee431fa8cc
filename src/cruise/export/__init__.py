"""Policies for other programs: an ONNX model, or one C99 header."""
