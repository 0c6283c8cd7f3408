"""What past runs tell about the next one."""
