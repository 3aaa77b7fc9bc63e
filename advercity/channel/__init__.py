"""The V2X channel: radio paths between stations, messages, and their delivery."""
