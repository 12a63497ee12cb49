"""Multiple shooting: a start for records on which one long simulation leads nowhere."""
