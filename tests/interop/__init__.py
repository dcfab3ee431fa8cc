"""Tests of `cruise.interop`."""
