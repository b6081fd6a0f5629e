from dronekeypp.environments import main

main()
