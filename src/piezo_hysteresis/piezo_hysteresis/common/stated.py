"""What a user may state about records: the words of options, apart from what reads them."""

#: Initial condition of a record.
STARTS = ('auto', 'rest', 'step', 'settled', 'estimate')
#: Zero of the displacement of records.
ZEROS = ('auto', 'record', 'common')
#: Which time of the messages of a bag counts.
CLOCKS = ('recording', 'header')
