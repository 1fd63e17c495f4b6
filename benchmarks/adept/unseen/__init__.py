"""Things that may be out of sight: what may have happened to them, and how improbable what is seen then is."""
