"""What models without steps in time may lack: columns of a regression, parts of a static model."""
