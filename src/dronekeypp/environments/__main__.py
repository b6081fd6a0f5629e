"""`python -m dronekeypp.environments` draws the contact sheet."""

from dronekeypp.environments import main

if __name__ == "__main__":
    main()
