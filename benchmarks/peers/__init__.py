"""CRUISE beside what people use instead, on the same machine in the same run."""
