"""Tables as programs export them: their layouts, and what their columns mean."""
