-- Neovim opens a SPEL+ project with the language server, and does with it what a person would.
-- The environment has SERVER, the server's command, and OUT, the file for what came out.
local out = { diagnostics = {} }
local function wait(what, condition)
  if not vim.wait(100000, condition, 20) then error(what .. ' did not come') end
end
local client = vim.lsp.start_client({
  name = 'spel', cmd = vim.split(vim.env.SERVER, ' '), root_dir = vim.fn.getcwd(),
  init_options = { version = 7 },
})
local function open(file)
  vim.cmd('edit ' .. file)
  vim.lsp.buf_attach_client(0, client)
end
local ok, message = pcall(function()
  open('main.prg')
  wait('the server', function() return vim.lsp.buf_is_attached(0, client) and #vim.lsp.buf_get_clients(0) > 0 end)
  wait('diagnostics', function() return #vim.diagnostic.get(0) > 0 end)
  for _, item in ipairs(vim.diagnostic.get(0)) do
    table.insert(out.diagnostics, { item.lnum, item.col, item.message, item.code })
  end
  local symbols = vim.lsp.buf_request_sync(0, 'textDocument/documentSymbol', {
    textDocument = vim.lsp.util.make_text_document_params() }, 100000)
  out.outline = vim.tbl_map(function(item) return item.name end, symbols[client].result)
  -- go to the definition of Help, called in main.prg
  vim.fn.search('Help', 'w')
  local window = vim.fn.expand('%:t')
  vim.lsp.buf.definition()
  wait('the definition', function() return vim.fn.expand('%:t') ~= window end)
  out.definition = { vim.fn.expand('%:t'), vim.fn.line('.'), vim.fn.col('.') }
  -- rename the point and the output in all files
  vim.cmd('buffer main.prg')
  for old, new in pairs({ pick = 'grasp', Gripper = 'Vacuum' }) do
    vim.fn.cursor(1, 1)
    vim.fn.search('\\<' .. old .. '\\>', 'w')
    vim.lsp.buf.rename(new)
    wait('the new name', function() return vim.fn.search('\\<' .. new .. '\\>', 'nw') > 0 end)
  end
  if vim.lsp.buf.format then
    vim.lsp.buf.format({ timeout_ms = 100000 })
  else
    vim.lsp.buf.formatting_sync(nil, 100000) -- up to Neovim 0.7
  end
  vim.cmd('silent! wall')
end)
out.error = ok and '' or tostring(message)
vim.fn.writefile({ vim.fn.json_encode(out) }, vim.env.OUT)
vim.cmd('qall!')
