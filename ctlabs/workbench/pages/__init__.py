"""The pages: thin views of a session. ``shell`` draws the frame; the others each have one function ``page(session, shell)``."""
