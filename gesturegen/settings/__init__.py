"""Settings: frozen models, how they are read, and how a mistake is told."""
