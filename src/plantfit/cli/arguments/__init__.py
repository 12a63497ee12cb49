"""What a command line gives as text, read: values by name, numbers with units, names of files."""
