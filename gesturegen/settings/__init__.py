"""Settings: frozen models, their reading, and the messages about mistakes in them."""
