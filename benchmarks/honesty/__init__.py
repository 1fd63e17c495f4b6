"""How honest is a belief? Proper scores of what is believed in random episodes, beside the truth."""
