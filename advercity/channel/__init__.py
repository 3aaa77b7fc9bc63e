"""The V2X channel: radio paths between stations, messages, and what becomes of them."""
