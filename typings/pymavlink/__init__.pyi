# The corner of pymavlink that robotree uses: the generator and its parser.
