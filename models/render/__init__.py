"""Scene generator and path tracer that write capture folders with truth."""
